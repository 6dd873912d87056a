"""Operations of the viscous forces."""

from refsim.core.operation import SYMMETRY, operations
from refsim.neighbours.sums import Fields, neighbours
from refsim.sph.viscosities import reference as ref

operation = operations(
    adds="acceleration", optional="period", tolerance=12.0,
    reason="one rounding in each of distance, slope, velocity difference, projection, quotients, products and sum;"
    " the size counts |v_i| and |v_j|, not |v_i - v_j|",
)  # fmt: skip


@operation(
    "artificial viscosity, alpha and beta", paper="Monaghan 1992", packed="artificial_pair",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum galilean dissipation",
    broken={1: "rotation angular_momentum"},
)  # fmt: skip
def artificial(position, velocity, mass, density, smoothing, artificial_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by artificial viscosity."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density)
    alpha, beta, c, h = artificial_viscosity
    around = neighbours(i, i, smoothing, period=period, rows=rows)
    return {"acceleration": around(ref.artificial, alpha=alpha, beta=beta, c=c, h=h)}


@operation(
    "laminar viscosity at low Reynolds numbers", paper="Morris, Fox & Zhu 1997", packed="laminar_pair",
    invariants=f"{SYMMETRY} linear_momentum galilean dissipation", broken={1: "rotation"},
)  # fmt: skip
def laminar(position, velocity, mass, density, smoothing, laminar_viscosity, period=None, rows=None):
    """Acceleration [m/s^2] by laminar viscosity."""
    i = Fields(position=position, velocity=velocity, mass=mass, density=density)
    mu, h = laminar_viscosity
    return {"acceleration": neighbours(i, i, smoothing, period=period, rows=rows)(ref.laminar, mu=mu, h=h)}
