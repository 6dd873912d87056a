"""Operations of Akinci et al. 2013; arrays position, normals (n, 3); mass, density (n,), in SI units."""

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import fused_with_momentum
from refsim.surface_tension.akinci_2013 import reference as ref

operation = operations(paper="Akinci, Akinci & Teschner 2013")


@operation(
    "cohesion, area term and K_ij", adds="acceleration",
    variants=("area_term area_normal axial", "axial", "spline axial", ""), tolerance=12.0,
    reason="one rounding in each of distance, K_ij, the cubes of the spline, direction, product and sum; not in the"
    " bound: the area term does not vanish at r = h, so that a pair which a rounding moves across r = h changes a by"
    " K_ij eps |n_i - n_j|, at most 3.2 s^2 eps with s = rho0 over the least density near by: the longest normal is"
    " that of a half-space of liquid, h int W dA over its surface, which is below 1.6, times s for V_j = m_j/rho_j,"
    " and K_ij is at most s",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum",
    broken=dict.fromkeys((1, 2, 3), "linear_momentum angular_momentum"),
    programs=fused_with_momentum("period axial", "area_term area_normal axial walls period", "period"),
    packed="tension_pair",
)  # fmt: skip
def tension(position, mass, density, area_normal, smoothing, fluid, spline, area_term, axial, rows=None):
    """Acceleration F/m [m/s^2] by cohesion and area term, each unless None."""
    i = Fields(position=position, mass=mass, density=density, normal=area_normal)
    around, a, rest = neighbours(i, i, smoothing, rows=rows).others, 0.0, float(fluid.rest_density)
    if spline is not None:
        a = around(ref.cohesion, gamma=spline.gamma, rest=rest)
    if area_term is not None:
        along = None if axial is None else float(axial.factor)
        a = a + around(ref.area, eps=area_term.coefficient, rest=rest, along=along)
    return {"acceleration": a}


@operation(
    "adhesion A(r), with the walls' Psi_b", adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, direction, product and sum, and two roots", invariants=SYMMETRY,
)  # fmt: skip
def adhesion(position, walls, smoothing, fluid, adhesion, rows=None):
    """Acceleration [m/s^2] by the adhesion to wall particles."""
    i, b = Fields(position=position), wall_particles(walls, fluid)
    return {"acceleration": neighbours(i, b, smoothing, rows=rows)(ref.adhesion, beta=adhesion.beta)}
