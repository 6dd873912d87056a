"""Operations of He et al. 2014; arrays position (n, 3); mass, density, color (n,), in SI units."""

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.sums import Fields, neighbours, wall_particles
from refsim.sph.operations import fused_with_momentum
from refsim.surface_tension.he_2014 import reference as ref

operation = operations(paper="He et al. 2014")


@operation("smoothed color c", outputs="color", optional="walls", invariants=SYMMETRY, packed="color_pair")
def color(position, mass, density, walls, smoothing, rows=None):
    """Smoothed colors of liquid and walls, i itself included; dimensionless."""
    i = Fields(position=position, mass=mass, density=density)
    around, at_walls = (neighbours(i, j, smoothing, rows=rows) for j in (i, wall_particles(walls)))
    return {"color": around(ref.color) + at_walls(ref.wall_color)}


@operation(
    "|grad c|^2", outputs="color_gradient_squared", tolerance=16.0,
    reason="those of one pair twice, for the square, and the quotient", invariants=SYMMETRY, packed="gradient_pair",
)  # fmt: skip
def squared_gradient(position, mass, density, color, gradient_smoothing, rows=None):
    """|grad c_i|^2 [1/m^2]."""
    i = Fields(position=position, mass=mass, density=density, color=color)
    around = neighbours(i, i, gradient_smoothing, rows=rows)
    gradient = around(ref.color_gradient) / around.i.color
    return {"color_gradient_squared": gradient @ gradient}


@operation(
    "gradient energy; air pressure", adds="acceleration",
    variants=("gradient_energy color_gradient_squared", "", "air_pressure"), tolerance=12.0,
    reason="one rounding in each of distance, slope, volume, two factors, direction, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum",
    programs=fused_with_momentum("period", "gradient_energy color_gradient_squared walls period"),
    packed="tension_pair",
)  # fmt: skip
def tension(
    position, mass, density, color_gradient_squared, gradient_smoothing, gradient_energy, air_pressure, rows=None
):
    """Acceleration [m/s^2] by gradient energy and air pressure, each unless None."""
    i = Fields(position=position, mass=mass, density=density, squared=color_gradient_squared)
    around, a = neighbours(i, i, gradient_smoothing, rows=rows), 0.0
    if gradient_energy is not None:
        a = around(ref.gradient_energy, kappa=gradient_energy.kappa)
    if air_pressure is not None:
        a = a + around(ref.air_pressure, p_atm=air_pressure.pressure)
    return {"acceleration": a}
