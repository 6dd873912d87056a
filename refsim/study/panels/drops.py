"""What is read of a drop: its density and radius, the swing of the mode n = 2 and its fit, its angle on a plane.

Lengths in spacings, rho0 = 1 and the nominal sigma = 1.
"""

import itertools
import math
import warnings
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from refsim.backends.arrays import Backend
from refsim.engine.binding import bind_pass
from refsim.engine.simulation import Simulation
from refsim.smoothing.reference import kernel_slope

RAYLEIGH = {2: 6.0, 3: 8.0}  # omega^2 = k sigma/(rho R^3)
PERIODS = 2.25  # of the oscillation that are fitted
SNAPSHOTS, PER_PERIOD, SNAPSHOTS_ON_PLANE = 40, 24, 45
THIN = 0.03  # Ohnesorge number mu/sqrt(rho sigma R) while measuring
INNER = 0.6  # of R: where density is taken
BALLS = np.linspace(0.4, 0.7, 7)  # of R: in which the pressure is taken


def radius_of(volume: float, dim: int) -> float:
    """Radius of a ball (disc)."""
    return (3 * volume / (4 * math.pi)) ** (1 / 3) if dim == 3 else math.sqrt(volume / math.pi)


def second_moment(simulation: Simulation, dim: int) -> float:
    """Second moment of the mode n = 2 over the mean square radius."""
    x = simulation.field("position").astype(float)
    square = ((x - x.mean(0)) ** 2).mean(0)
    top = square[0] + square[1] - 2 * square[2] if dim == 3 else square[0] - square[1]
    return float(top / square.sum())


def fit_oscillation(times: NDArray, values: NDArray, expected: float) -> tuple[float, float, float, float]:
    """(omega [1/s], beta [1/s], misfit, A) of a + b t + A exp(-beta t) sin(omega t + phi); NaN where nothing fits.

    misfit  rms of what is left over the rms of the values about their line
    """
    from scipy.optimize import OptimizeWarning, curve_fit

    def curve(t: NDArray, a: float, b: float, amplitude: float, beta: float, omega: float, phase: float) -> NDArray:
        return a + b * t + amplitude * np.exp(-beta * t) * np.sin(omega * t + phase)

    spread = float(np.abs(values - values[0]).max())
    best = (math.nan, math.nan, math.nan, math.nan)
    line = values - np.polyval(np.polyfit(times, values, 1), times)
    for factor, damping in itertools.product((0.6, 0.8, 1.0, 1.25, 1.5), (0.05, 0.3)):
        guess = (float(values[0]), 0.0, spread, damping * expected, factor * expected, 0.0)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", OptimizeWarning)
                fit, _ = curve_fit(curve, times, values, guess, maxfev=4000)
        except RuntimeError:
            continue
        rest = float(np.std(values - curve(times, *fit)) / max(np.std(line), 1e-30))
        if fit[4] > 0 and fit[3] > -0.1 * expected and not rest >= best[2]:
            best = (float(fit[4]), float(fit[3]), rest, abs(float(fit[2])))
    return best


def cap_volume(angle: float, dim: int) -> float:
    """Volume (area in 2D) of a spherical cap of radius 1 with a contact angle [rad]."""
    c = math.cos(angle)
    return math.pi / 3 * (2 + c) * (1 - c) ** 2 if dim == 3 else angle - math.sin(angle) * c


def angle_by_lift(lift: float, dim: int) -> float:
    """Contact angle [degrees] of the cap whose centre of mass stands at `lift` = height/volume^(1/dim)."""
    angles, lifts = np.linspace(2.0, 178.0, 353), []
    for angle in np.radians(angles).tolist():
        c, volume = math.cos(angle), cap_volume(angle, dim)
        moment = math.pi / 4 * (1 - c**2) ** 2 if dim == 3 else 2 / 3 * math.sin(angle) ** 3  # about the centre
        lifts.append((moment / volume - c) / volume ** (1 / dim))
    return float(np.interp(lift, lifts, angles))


def inside(simulation: Simulation, radius: float) -> tuple[float, float]:
    """(mean density of the particles within INNER of a drop's nominal radius, radius of the drop with that density)."""
    x, dim = simulation.field("position").astype(float), simulation.plan.grid.dim
    within = np.linalg.norm(x - x.mean(0), axis=1) < INNER * radius
    density = float(simulation.field("density").astype(float)[within].mean())
    return density, radius_of(simulation.field("mass").astype(float).sum() / density, dim)


# Pressure from the forces between particles

OF_NO_PAIR = ("gravity", "csf_wang_2019")  # the continuum force acts at the surface only


def pair_virials(simulation: Simulation) -> tuple[NDArray, NDArray, NDArray]:
    """(i, j, half of x_ij . F_ij [J; J/m in 2D]) of every neighbour j of every i; F_ij acts on i.

    Of pressure and tension; viscosity and walls are left out. Evaluate the simulation first.
    """
    grid = simulation.plan.grid
    position = simulation.field("position").astype(float)
    pairs = cKDTree(position).query_pairs(grid.support_radius, output_type="ndarray")
    both = np.concatenate([pairs, pairs[:, ::-1]])
    i, j = both[np.argsort(both[:, 0], kind="stable")].T
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
