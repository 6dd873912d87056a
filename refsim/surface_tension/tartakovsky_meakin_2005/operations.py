"""Operations of Tartakovsky & Meakin 2005; arrays position (n, 3); mass (n,), in SI units."""

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.sums import Fields, neighbours
from refsim.surface_tension.tartakovsky_meakin_2005 import reference as ref


@operation(
    "pair force s cos(3 pi r/(2 h))", "tartakovsky_meakin_2005.cohesion", paper="Tartakovsky & Meakin 2005",
    adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, argument, cosine, direction, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="cosine_pair",
)  # fmt: skip
def cosine_cohesion(position, mass, smoothing, cosine_force, rows=None):
    """Acceleration [m/s^2] by the cosine-shaped pair force."""
    i = Fields(position=position, mass=mass)
    return {"acceleration": neighbours(i, i, smoothing, rows=rows).others(ref.cohesion, s=cosine_force.strength)}
