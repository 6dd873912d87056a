"""Operations of Jiang & Zhu 2023; arrays position, normals (n, 3); mass, density, weights, marks (n,), in SI units."""

import numpy as np

from refsim.core.operation import SYMMETRY, operations, without
from refsim.core.terms import where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import fused_with_momentum
from refsim.surface_tension.jiang_zhu_2023 import reference as ref

operation = operations(paper="Jiang & Zhu 2023")
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
    return fused_with_momentum(without(left_out) | _ALL | without("period"), *more)


@operation(
    "Shepard filter of all densities; J(14), J(15)", "dong_2016.shepard_filter", paper="Dong, Zhang & Chen 2016",
    outputs="corrected_density", variants=("near_surface walls", "near_surface"), tolerance=8.0, reason=_TWO_SUMS,
    invariants=SYMMETRY, packed="corrected_density_pair",
)  # fmt: skip
@operation(
    "J(14), J(15) with Jiang & Zhu E8", outputs="corrected_density", optional="walls near_surface", tolerance=8.0,
    reason=_TWO_SUMS, invariants=SYMMETRY,
)  # fmt: skip
def corrected_density(position, mass, density, near_surface, walls, smoothing, fluid, rows=None):
    """Density [kg/m^dim], corrected where `near_surface` is set, everywhere if it is None; i itself included."""
    i = Fields(position=position, mass=mass, density=density, near=1 if near_surface is None else near_surface)
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls, fluid)))
    filled = around(ref.filled) + at_walls(ref.wall_filled)
    corrected = ref.corrected_density(around(ref.summed_density) + at_walls(ref.summed_density), filled)
    return {"corrected_density": where(around.i.near, corrected, around.i.density)}


@operation("J(14), in place of J(7)", outputs="density", tolerance=0.0, reason="a copy", invariants="reordering")
def replace_density(corrected_density, rows=None):
    """rho_i <- rho*_i [kg/m^dim], J(14)."""
    return {"density": Fields(rho=corrected_density).at(rows).rho}


@operation(
    "Jiang & Zhu E9: smoothstep of |h grad c|, J(19)", paper="in place of the surface set of Jiang & Zhu 2023",
    outputs="surface_weight", tolerance=8.0, reason="roundings of the normal's length, of the ramp and of the cubic",
    invariants="rotation reordering",
)  # fmt: skip
def soft_weight(surface_normal, soft, rows=None):
    """Weights of J(19)'s normals between 0 and 1; dimensionless."""
    n = Fields(normal=surface_normal).at(rows).normal
    return {"surface_weight": ref.soft_weight(n, float(soft.lower), float(soft.upper))}


@_pair_force(
    "J(16), J(17), J(21); J(18) with Jiang & Zhu E11",
    variants=(_ALL | without("area area_normal"), _SOFT, _ALL, _EITHER, _BOTH, _ONE_SIDED, _AXIAL), reason=_EDGE,
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", programs=_fused("", _AXIAL | without("period")),
    broken=dict.fromkeys((1, 2, 3, 4), "angular_momentum") | {5: "linear_momentum angular_momentum"},
)  # fmt: skip
@_pair_force(
    "J(16) with Jiang & Zhu E4, J(17) with Jiang & Zhu E7", "jiang_zhu_2023.cohesion",
    variants=tuple(mode | without("area area_normal") for mode in (_ALL, _SOFT, _EITHER, _ONE_SIDED)),
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", programs=_fused("area area_normal walls"),
    broken={3: "linear_momentum angular_momentum"},
)  # fmt: skip
def tension(
    position, mass, density, surface_weight, surface, area_normal, smoothing, pairs, cohesion, area, axial, rows=None
):
    """Acceleration F/m [m/s^2] by the pair force and the area term; marks and weights that are None count as 0."""
    marks = 0 if surface is None else np.asarray(surface) != 0
    i = Fields(
        position=position, mass=mass, density=density, normal=area_normal, surface=marks,
        weight=0 if surface_weight is None else surface_weight,
    )  # fmt: skip
    around, a = neighbours(i, i, smoothing, rows=rows).others, 0.0
    mode, along = int(pairs.mode), None if axial is None else float(axial.factor)
    if cohesion is not None:
        of = {"gamma": cohesion.gamma, "alpha": cohesion.alpha, "beta": cohesion.beta}
        a = around(ref.cohesion, mode=mode, **of)
    if area is not None:
        term = ref.area if int(area.kind) == 0 else ref.simple_area
        a = a + around(term, mode=mode, eps=area.coefficient, along=along)
    return {"acceleration": a}
