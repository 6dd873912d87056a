"""NumPy oracle of Jiang & Zhu 2023: all pairs, float64.

Arrays: position, normals (n, 3); mass, density, weights, marks (n,); SI units.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, Program, operations, without
from refsim.neighbours.reference import Sums, pair_blocks, rows_of
from refsim.smoothing.reference import kernel_value
from refsim.surface_normal.reference import normals_apart

operation = operations(paper="Jiang & Zhu 2023")
INNER = 0.8  # the repulsive kernel's support, as a share of h
MODES = ("soft", "all", "one_sided", "either", "both")

_TWO_SUMS = "the roundings of one pair in each of two sums, and their quotient"
_EDGE = (
    "one rounding in each of distance, two or three kernels, products and sum; not in the bound: the area term does not"
    " vanish at r = h, so that a pair which a rounding moves across r = h changes a by (eps/rho_i) V_j |n*_i - n*_j| in"
    " J(21) and eps' |n_i - n_j| in J(18), at most 3.2 s eps' (as akinci_2013.tension)"
)
# Numbers of MODES, and what they do without
_SOFT = without("surface axial", pairs={"mode": 0})
_AXIAL = without("surface_weight surface", pairs={"mode": 1})
_ALL = _AXIAL | without("axial")
_ONE_SIDED, _EITHER, _BOTH = (without("surface_weight axial", pairs={"mode": mode}) for mode in (2, 3, 4))
_pair_force = operations(
    paper="Jiang & Zhu 2023", adds="acceleration", optional="surface_weight surface area_normal cohesion area axial",
    tolerance=12.0,
)  # fmt: skip


def _fused(left_out, *more):
    """The program that sums the pair forces between all pairs in one loop with pressure and viscosity."""
    return {
        "cuda:fused": Program(
            "kernels", "tension_and_momentum", packed="fused_pair", also=("sph.momentum",),
            names={"smoothing": "gradient_smoothing"}, variants=(without(left_out) | _ALL | without("period"), *more),
        ),
    }  # fmt: skip


@operation(
    "Shepard filter of all densities; J(14), J(15)", "dong_2016.shepard_filter", paper="Dong, Zhang & Chen 2016",
    outputs="corrected_density", optional="walls near_surface", variants=("near_surface walls", "near_surface"),
    tolerance=8.0, reason=_TWO_SUMS, invariants=SYMMETRY, packed="corrected_density_pair",
)  # fmt: skip
@operation(
    "J(14), J(15) with Jiang & Zhu E8", outputs="corrected_density", optional="walls near_surface", tolerance=8.0,
    reason=_TWO_SUMS, invariants=SYMMETRY,
)  # fmt: skip
def corrected_density(position, mass, density, near_surface, walls, smoothing, fluid, rows=None):
    """Density [kg/m^dim], corrected where `near_surface` is set, everywhere if it is None; self included, one pass.

    J(14), J(15) rho*_i = sum_j m_j W_ij / sum_k (m_k/rho_k) W_ik; walls m_k -> rho0 V_b, rho_k -> rho_i.
    """
    mass, rho = np.asarray(mass, dtype=float), np.asarray(density, dtype=float)
    own = rows_of(density, rows)
    above, below = np.zeros(len(own)), np.zeros(len(own))
    for place, _, distance in pair_blocks(position, position, rows):
        w = kernel_value(distance, smoothing)
        above[place] += w @ mass
        below[place] += w @ (mass / rho)
    if walls is not None:
        filling = float(fluid.rest_density) * np.asarray(walls.volume, dtype=float)
        for place, _, distance in pair_blocks(position, walls.position, rows):
            w = kernel_value(distance, smoothing)
            above[place] += w @ filling
            below[place] += (w @ filling) / own[place]
    value = above / below
    if near_surface is not None:
        value = np.where(rows_of(near_surface, rows) != 0, value, own)
    return {"corrected_density": (value, 2 * value)}


@operation("J(14), in place of J(7)", outputs="density", tolerance=0.0, reason="a copy", invariants="reordering")
def replace_density(corrected_density, rows=None):
    """rho_i <- rho*_i [kg/m^dim], J(14)."""
    value = rows_of(corrected_density, rows)
    return {"density": (value, value)}


@operation(
    "Jiang & Zhu E9: smoothstep of |h grad c|, J(19)", paper="in place of the surface set of Jiang & Zhu 2023",
    outputs="surface_weight", tolerance=8.0, reason="roundings of the normal's length, of the ramp and of the cubic",
    invariants="rotation reordering",
)  # fmt: skip
def soft_weight(surface_normal, soft, rows=None):
    """w = 3 t^2 - 2 t^3, t = (|n| - lower)/(upper - lower) held in 0..1, n = h grad c of J(19); dimensionless.

    The scale is the value's change where t moves by its own terms, |n| and the bounds, over the width.
    """
    lower, upper = float(soft.lower), float(soft.upper)
    steepness = np.sqrt((rows_of(surface_normal, rows) ** 2).sum(-1))
    t = np.clip((steepness - lower) / (upper - lower), 0, 1)
    return {"surface_weight": (t**2 * (3 - 2 * t), 1.5 * (steepness + lower) / (upper - lower) + 3 * t**2 + 2 * t**3)}


def pair_shares(mode, weight_i, weight_j, surface_i, surface_j):
    """Share of each pair force that acts on i (Jiang & Zhu E9); dimensionless, for arrays that broadcast."""
    name = MODES[int(mode)]
    on_i, on_j = np.asarray(surface_i) != 0, np.asarray(surface_j) != 0
    if name == "soft":
        return (np.asarray(weight_i, dtype=float) + np.asarray(weight_j, dtype=float)) / 2
    acts = {
        "all": np.ones(np.broadcast(on_i, on_j).shape, dtype=bool),
        "one_sided": on_i & np.ones_like(on_j),
        "either": on_i | on_j,
        "both": on_i & on_j,
    }
    return acts[name].astype(float)


@_pair_force(
    "J(16), J(17), J(21); J(18)",
    variants=(_ALL | without("area area_normal"), _SOFT, _ALL, _EITHER, _BOTH, _ONE_SIDED, _AXIAL), reason=_EDGE,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", programs=_fused("", _AXIAL | without("period")),
    broken=dict.fromkeys((1, 2, 3, 4), "angular_momentum") | {5: "linear_momentum angular_momentum"},
)  # fmt: skip
@_pair_force(
    "J(21); J(18) with Jiang & Zhu E11", "jiang_zhu_2023.area",
    variants=(_ALL | without("cohesion"), _SOFT | without("cohesion")), reason=_EDGE,
    invariants=f"{SYMMETRY} linear_momentum",
)  # fmt: skip
@_pair_force(
    "J(16) with Jiang & Zhu E4, J(17) with Jiang & Zhu E7", "jiang_zhu_2023.cohesion",
    variants=tuple(mode | without("area area_normal") for mode in (_ALL, _SOFT, _EITHER)),
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", programs=_fused("area area_normal walls"),
)  # fmt: skip
def tension(
    position, mass, density, surface_weight, surface, area_normal, smoothing, pairs, cohesion, area, axial, rows=None
):
    """Acceleration F/m [m/s^2] by the pair force and the area term; marks and weights that are None count as 0.

    J(16) a_i = gamma sum_j m_j C(r) e_ij (Jiang & Zhu E4); J(17) C = alpha W_poly6(r, 0.8h) - beta W_poly6(r, h);
    J(21) a_i = -eps sum_j m_j/(rho_i rho_j) (n*_i - n*_j); J(18) a_i = -eps' sum_j (n_i - n_j).
    By `axial` n_i - n_j along e_ij alone, s ((n_i - n_j) . e_ij) e_ij.
    """
    marks, terms = (surface_weight, surface, int(pairs.mode)), (area_normal, area, axial)
    return {"acceleration": _pair_sums(position, mass, density, marks, smoothing, cohesion, terms, rows)}


def _pair_sums(position, mass, density, marks, smoothing, cohesion, terms, rows):
    surface_weight, surface, mode = marks
    area_normal, area, axial = terms
    h, dim = float(smoothing.support_radius), smoothing.dim
    mass = np.asarray(mass, dtype=float)
    count = len(mass)
    weight = np.zeros(count) if surface_weight is None else np.asarray(surface_weight, dtype=float)
    marked = np.zeros(count) if surface is None else np.asarray(surface)
    own = np.arange(count) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        i = own[place]
        near = (distance < h) & (i[:, None] != np.arange(count)[None, :])
        share = near * pair_shares(mode, weight[i, None], weight[None, :], marked[i, None], marked[None, :])
        if cohesion is not None:
            unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
            repulsion = float(cohesion.alpha) * _poly6(distance, INNER * h, dim)
            attraction = float(cohesion.beta) * _poly6(distance, h, dim)
            strength = float(cohesion.gamma) * share * mass[None, :]
            size = (np.abs(strength) * (repulsion + attraction))[..., None] * np.abs(unit)
            sums.add(place, (strength * (repulsion - attraction))[..., None] * unit, size)
        if area is not None:
            factor = float(area.coefficient) * share
            if int(area.kind) == 0:
                rho = np.asarray(density, dtype=float)
                factor = factor * (mass / rho)[None, :] / rho[i, None]
            apart, size = normals_apart(area_normal, i, separation, distance, axial)
            sums.add(place, -factor[..., None] * apart, np.abs(factor)[..., None] * size)
    return sums.total()


def _poly6(r, radius, dim):
    """Poly6 kernel W(r, radius) [1/m^dim] at distances r [m]."""
    norm = 4 / np.pi if dim == 2 else 315 / (64 * np.pi)
    return np.where(r < radius, norm / radius**dim * (1 - (r / radius) ** 2) ** 3, 0.0)
