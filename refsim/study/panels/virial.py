"""Pressure of a liquid from the forces between its particles (Irving & Kirkwood 1950): what a drop really holds.

The pressure of the equation of state is not the liquid's: it carries the cohesion, too, which is ten to fifty times the
jump sigma/R. The virial of all pair forces is the difference of the two.
"""

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from refsim.backends.arrays import Backend
from refsim.engine.binding import bind_pass
from refsim.engine.simulation import Simulation
from refsim.smoothing.reference import kernel_slope

OF_NO_PAIR = ("gravity", "csf_wang_2019")  # the continuum force acts at the surface only


def pair_virials(simulation: Simulation) -> tuple[NDArray, NDArray, NDArray]:
    """(i, j, half of x_ij . F_ij [J; J/m in 2D]) of every neighbour j of every i; F_ij acts on i.

    Of pressure and tension; viscosity and walls are left out. Evaluate the simulation first.
    """
    grid = simulation.plan.grid
    position = simulation.field("position").astype(float)
    pairs = cKDTree(position).query_pairs(grid.support_radius, output_type="ndarray")
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    order = np.argsort(i, kind="stable")
    i, j = i[order], j[order]
    acceleration = _accelerations(simulation, i, j)
    apart = position[i] - position[j]
    mass = simulation.field("mass").astype(float)
    virial = mass[i] * (acceleration * apart).sum(1)
    if "iisph" in simulation.plan.effects:
        # Ihmsen et al. 2014: F_ij = -m_i m_j (p_i/rho_i^2 + p_j/rho_j^2) W' e_ij, the pressures those of the last step.
        r = np.sqrt((apart**2).sum(1))
        over = simulation.field("pressure").astype(float) / simulation.field("density").astype(float) ** 2
        slope = kernel_slope(r, simulation.plan.shared["gradient_smoothing"])
        virial -= mass[i] * mass[j] * (over[i] + over[j]) * slope * r
    return i, j, virial / 2


def _accelerations(simulation: Simulation, i: NDArray, j: NDArray) -> NDArray:
    """Acceleration of `i` [m/s^2] by each neighbour `j`: the programs of the plan, with lists of one neighbour each."""
    from refsim.neighbours.rows import NeighbourRows  # loads Numba

    plan, grid, cpu = simulation.plan, simulation.plan.grid, Backend("cpu")
    passes = [(e, p) for e, p in plan.passes if "acceleration" in p.updates and e.name not in OF_NO_PAIR]
    fields = {}
    for name in {"acceleration"}.union(*(p.reads for _, p in passes)):
        values = grid.local(simulation.field(name)) if name == "position" else simulation.field(name)
        fields[name] = np.array(values, plan.fields[name].numpy_dtype(grid.dtype))
    if "velocity" in fields:
        fields["velocity"][:] = 0
    count = np.bincount(i, minlength=grid.count)
    first = np.cumsum(count) - count
    result = np.empty((len(i), fields["acceleration"].shape[1]))
    for k in range(count.max(initial=0)):
        has = count > k
        fields["acceleration"][:] = 0
        rows = NeighbourRows(first + k, has.astype(np.int32), j.astype(np.uint32))
        shared = {"liquid_near_walls": None, **plan.shared, "walls": None, "neighbours": rows}
        for effect, p in passes:
            bind_pass(p, cpu, (plan.parameters[effect.name], shared, fields))()
        result[first[has] + k] = fields["acceleration"][has]
    return result


def inner_pressure(simulation: Simulation, radii: Iterable[float]) -> float:
    """Mean over the balls (discs) of the `radii` [m] about the centre of mass of the pressure [Pa] in each.

    P = (1/(dim V)) sum_pairs w x_ij . F_ij, w the share of the line between the two that lies in the ball (Irving &
    Kirkwood). Particles of a drop stand in shells; one ball tells where its edge lies between two of them, too.
    """
    dim = simulation.plan.grid.dim
    position = simulation.field("position").astype(float)
    position -= position.mean(0)
    i, j, virial = pair_virials(simulation)
    away = np.sqrt((position**2).sum(1))
    nearer, farther = np.minimum(away[i], away[j]), np.maximum(away[i], away[j])
    pressures = []
    for radius in radii:
        volume = 4 / 3 * np.pi * radius**3 if dim == 3 else np.pi * radius**2
        # A line of the length h that cuts the ball has an end nearer than this.
        cut = (farther > radius) & (nearer < math.hypot(radius, simulation.plan.grid.support_radius))
        whole = virial[farther <= radius].sum()
        shares = share_inside(position[i[cut]], position[j[cut]], radius)
        pressures.append((whole + (shares * virial[cut]).sum()) / (dim * volume))
    return float(np.mean(pressures))


def share_inside(first: NDArray, second: NDArray, radius: float) -> NDArray:
    """Share (k,) of the lines from `first` to `second` (k, 3) that lies in the ball of `radius` about the origin."""
    along = second - first
    square, slope = (along**2).sum(1), (first * along).sum(1)
    root = slope**2 - square * ((first**2).sum(1) - radius**2)
    half = np.sqrt(np.maximum(root, 0))
    enter, leave = (np.clip((-slope + sign * half) / square, 0, 1) for sign in (-1, 1))
    return np.where(root > 0, leave - enter, 0.0)
