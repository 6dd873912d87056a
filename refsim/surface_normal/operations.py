"""Operations of surface normals.

Arrays: position (n, 3) [m]; mass [kg], density [kg/m^dim], number_density [1/m^dim] (n,); candidates (n,) uint8
or None.
"""

from refsim.core.operation import SYMMETRY, operations
from refsim.core.terms import where
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.surface_normal import reference as ref

# Hard inputs of normals and of the fan scan, beside those of every operation.
SHAPES = ("two_layers", "three_layers", "jittered_film", "bent_filament", "cavity", "tank_corner", "notch")
operation = operations(
    paper="Jiang & Zhu 2023", cases=SHAPES, optional="walls candidates",
    variants=("walls candidates", "", "candidates", "walls"), invariants=SYMMETRY,
)  # fmt: skip


@operation("J(19) with Jiang & Zhu E10", outputs="surface_normal", tolerance=8.0, packed="normal_pair")
def color_gradient(position, mass, density, candidates, walls, gradient_smoothing, normal_term, rows=None):
    """Colour-gradient normals, inward, dimensionless; zero for particles that are no candidates."""
    i = Fields(position=position, mass=mass, density=density, candidate=1 if candidates is None else candidates)
    around, at_walls = (neighbours(i, j, gradient_smoothing, rows=rows) for j in (i, wall_particles(walls)))
    n = around(ref.color_gradient, printed=bool(normal_term.own_density)) + at_walls(ref.wall_color_gradient)
    return {"surface_normal": where(around.i.candidate, n, 0)}


@operation(
    "J(20), J(15) with Jiang & Zhu E10", outputs="corrected_normal", tolerance=12.0,
    reason="the roundings of one pair, and once more those of the denominator; the size counts delta_i and delta_j",
    packed="corrected_normal_pair",
)  # fmt: skip
def corrected(
    position, mass, density, number_density, candidates, walls, smoothing, gradient_smoothing, normal_term, rows=None
):
    """Corrected normals, inward [1/m]; zero for particles that are no candidates."""
    i = Fields(
        position=position, mass=mass, density=density, number=number_density,
        candidate=1 if candidates is None else candidates,
    )  # fmt: skip
    around, at_walls = (
        neighbours(i, j, smoothing, gradient_smoothing, rows=rows) for j in (i, wall_particles(walls))
    )  # fmt: skip
    given = {"delta0": normal_term.rest_number_density, "printed": bool(normal_term.own_density)}
    filled = around(ref.filled) + at_walls(ref.wall_filled)
    return {"corrected_normal": where(around.i.candidate, around(ref.density_rise, **given) / filled, 0)}
