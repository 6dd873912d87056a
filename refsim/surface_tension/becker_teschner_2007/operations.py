"""Operations of Becker & Teschner 2007; arrays position (n, 3); mass (n,), in SI units."""

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.sums import Fields, neighbours
from refsim.surface_tension.becker_teschner_2007 import reference as ref


@operation(
    "surface tension by attraction", paper="Becker & Teschner 2007", adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, kernel, product and sum, and a few in the spline's cubic",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="cohesion_pair",
)  # fmt: skip
def cohesion(position, mass, smoothing, attraction, rows=None):
    """Acceleration [m/s^2] by attraction."""
    i, of = Fields(position=position, mass=mass), {"kappa": attraction.kappa, "least_q": attraction.least_q}
    return {"acceleration": neighbours(i, i, smoothing, rows=rows).others(ref.cohesion, **of)}
