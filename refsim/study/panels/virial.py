"""Pressure of a liquid from the forces between its particles (Irving & Kirkwood 1950): what a drop really holds.

The pressure of the equation of state is not the liquid's: it carries the cohesion, too, which is ten to fifty times the
jump sigma/R. The virial of all pair forces is the difference of the two.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from refsim.engine.simulation import Simulation
from refsim.smoothing.reference import kernel_slope, kernel_value

Pairs = tuple[NDArray, NDArray, NDArray, NDArray]  # i, j, x_ij (k, 3), |x_ij|


def pair_virials(simulation: Simulation) -> tuple[NDArray, NDArray, NDArray]:
    """(i, j, x_ij . F_ij [J; J/m in 2D]) of every pair within the support; F_ij acts on i.

    Of pressure and tension; viscosity and walls are left out. Evaluate the simulation first. Raises ValueError for an
    effect whose pair forces are not known here.
    """
    grid, effects = simulation.plan.grid, simulation.plan.effects
    position = simulation.field("position").astype(float)
    found = cKDTree(position).query_pairs(grid.support_radius, output_type="ndarray")
    i, j = found[:, 0], found[:, 1]
    apart = position[i] - position[j]
    r = np.sqrt((apart**2).sum(1))
    keep = r > 0
    pairs = i[keep], j[keep], apart[keep], r[keep]
    total = _implicit_pressure(simulation, pairs) if "iisph" in effects else _pressure(simulation, pairs)
    for effect in effects.values():
        if effect.name in ("weakly_compressible", "iisph", "gravity", "surface_detection", "csf_wang_2019"):
            continue  # the continuum force is no pair's own, and acts at the surface only
        if effect.name not in _TENSIONS:
            raise ValueError(f"the pair forces of {effect.name} are not known here")
        total = total + _TENSIONS[effect.name](simulation, pairs)
    return pairs[0], pairs[1], total


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
    found = []
    for radius in radii:
        volume = 4 / 3 * np.pi * radius**3 if dim == 3 else np.pi * radius**2
        # A line of the length h that cuts the ball has an end nearer than this.
        cut = (farther > radius) & (nearer < math.hypot(radius, simulation.plan.grid.support_radius))
        whole = virial[farther <= radius].sum()
        shares = share_inside(position[i[cut]], position[j[cut]], radius)
        found.append((whole + (shares * virial[cut]).sum()) / (dim * volume))
    return float(np.mean(found))


def share_inside(first: NDArray, second: NDArray, radius: float) -> NDArray:
    """Share (k,) of the lines from `first` to `second` (k, 3) that lies in the ball of `radius` about the origin."""
    along = second - first
    square, slope = (along**2).sum(1), (first * along).sum(1)
    root = slope**2 - square * ((first**2).sum(1) - radius**2)
    half = np.sqrt(np.maximum(root, 0))
    enter, leave = (np.clip((-slope + sign * half) / square, 0, 1) for sign in (-1, 1))
    return np.where(root > 0, leave - enter, 0.0)


def _field(simulation: Simulation, name: str) -> NDArray:
    return simulation.field(name).astype(float)


def _pressure(simulation: Simulation, pairs: Pairs) -> NDArray:
    """J(10): F_ij = -s V_i V_j (p_i + p_j) W' e_ij."""
    i, j, _, r = pairs
    volume = _field(simulation, "mass") / _field(simulation, "density")
    pressure = _field(simulation, "pressure")
    shared = simulation.plan.shared
    share = float(shared["fluid"].gradient_share)
    slope = kernel_slope(r, shared["gradient_smoothing"])
    return -share * volume[i] * volume[j] * (pressure[i] + pressure[j]) * slope * r


def _implicit_pressure(simulation: Simulation, pairs: Pairs) -> NDArray:
    """Ihmsen et al. 2014: F_ij = -m_i m_j (p_i/rho_i^2 + p_j/rho_j^2) W' e_ij, the pressures those of the last step."""
    i, j, _, r = pairs
    mass = _field(simulation, "mass")
    over = _field(simulation, "pressure") / _field(simulation, "density") ** 2
    slope = kernel_slope(r, simulation.plan.shared["gradient_smoothing"])
    return -mass[i] * mass[j] * (over[i] + over[j]) * slope * r


def _central(simulation: Simulation, pairs: Pairs, name: str) -> NDArray:
    """F_ij = m_i m_j C(r) e_ij."""
    i, j, _, r = pairs
    plan, mass = simulation.plan, _field(simulation, "mass")
    force = plan.effects[name].pair_force(r, plan.grid, plan.effects)  # type: ignore[attr-defined]
    return mass[i] * mass[j] * force * r


def _along(normal: NDArray, pairs: Pairs, axial: Any = None) -> NDArray:
    """(n_i - n_j) . x_ij, times the factor of an area term along e_ij alone."""
    i, j, apart, _ = pairs
    return (1.0 if axial is None else float(axial.factor)) * ((normal[i] - normal[j]) * apart).sum(1)


def _jiang_zhu(simulation: Simulation, pairs: Pairs) -> NDArray:
    effect: Any = simulation.plan.effects["jiang_zhu_2023"]
    if effect.pair_mode not in ("all", "soft"):
        raise ValueError("of jiang_zhu_2023 only the pair modes 'all' and 'soft' are known here")
    total = _central(simulation, pairs, "jiang_zhu_2023")
    area, axial = (simulation.plan.parameters["jiang_zhu_2023"][name] for name in ("area", "axial"))
    if area is not None:
        i, j = pairs[:2]
        mass, density = _field(simulation, "mass"), _field(simulation, "density")
        eps = float(area.coefficient)
        if effect.area_term == "corrected":
            volume = mass / density
            total = total - eps * volume[i] * volume[j] * _along(_field(simulation, "corrected_normal"), pairs, axial)
        else:
            total = total - eps * mass[i] * _along(_field(simulation, "surface_normal"), pairs, axial)
    if effect.pair_mode == "soft":
        weight = _field(simulation, "surface_weight")
        total = 0.5 * (weight[pairs[0]] + weight[pairs[1]]) * total
    return total


def _akinci(simulation: Simulation, pairs: Pairs) -> NDArray:
    i, j = pairs[:2]
    groups, mass = simulation.plan.parameters["akinci_2013"], _field(simulation, "mass")
    density, rest = _field(simulation, "density"), float(simulation.plan.shared["fluid"].rest_density)
    total = np.zeros(len(i))
    if groups["spline"] is not None:
        total = total + _central(simulation, pairs, "akinci_2013")
    if groups["area_term"] is not None:
        along = _along(_field(simulation, "surface_normal"), pairs, groups["axial"])
        total = total - float(groups["area_term"].coefficient) * mass[i] * along
    return 2 * rest / (density[i] + density[j]) * total


def _dong(simulation: Simulation, pairs: Pairs) -> NDArray:
    i, j, _, r = pairs
    plan = simulation.plan
    if plan.effects["dong_2016"].solver != "shared":  # type: ignore[attr-defined]
        raise ValueError("of dong_2016 only the shared solver is known here")
    groups, mass, density = plan.parameters["dong_2016"], _field(simulation, "mass"), _field(simulation, "density")
    total = np.zeros(len(i))
    if groups["molecular_force"] is not None:
        total = total + _central(simulation, pairs, "dong_2016")
    correction = groups["normal_correction"]
    if correction is not None:
        volume = 2 * mass[i] * mass[j] / (density[i] + density[j])
        along = _along(_field(simulation, "surface_normal"), pairs)
        total = total - float(correction.coefficient) * volume * kernel_value(r, plan.shared["smoothing"]) * along
    return total


def _he(simulation: Simulation, pairs: Pairs) -> NDArray:
    i, j, _, r = pairs
    groups = simulation.plan.parameters["he_2014"]
    volume = _field(simulation, "mass") / _field(simulation, "density")
    factor = np.zeros(len(i))
    if groups["gradient_energy"] is not None:
        squared = _field(simulation, "color_gradient_squared")
        factor = factor + float(groups["gradient_energy"].quarter) * (squared[i] + squared[j])
    if groups["air_pressure"] is not None:
        factor = factor + float(groups["air_pressure"].pressure)
    return factor * volume[i] * volume[j] * kernel_slope(r, simulation.plan.shared["gradient_smoothing"]) * r


_TENSIONS: dict[str, Callable[[Simulation, Pairs], NDArray]] = {
    "jiang_zhu_2023": _jiang_zhu, "akinci_2013": _akinci, "dong_2016": _dong,
    "becker_teschner_2007": lambda simulation, pairs: _central(simulation, pairs, "becker_teschner_2007"),
    "tartakovsky_meakin_2005": lambda simulation, pairs: _central(simulation, pairs, "tartakovsky_meakin_2005"),
    "he_2014": _he,
}  # fmt: skip
