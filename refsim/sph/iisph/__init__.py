"""Implicit incompressible SPH: pressures that make the advected density the rest density (Ihmsen et al. 2014).

It replaces the equation of state and the pressure force of weakly_compressible. The step length is chosen before the
pressures are solved for: all other forces are summed first, and from them follows the advected density.
"""

from typing import Any, ClassVar, NamedTuple

from refsim.core.capabilities import SumsDensity
from refsim.core.checked import Count, Positive
from refsim.core.effect import Discretisation, Effect, Field, Others, Pass, StepLimit, int32
from refsim.core.errors import InputError
from refsim.smoothing import lattice_neighbours, smoothing
from refsim.smoothing.reference import kernel_slope
from refsim.sph import LIQUID, SETS, liquid_of

PRESSURE = Field("pressure", "Pa", "pressure p of the implicit solution, and the start of the next one", state=True)
OWN_DISPLACEMENT = Field("own_displacement", "m/Pa", "d_ii: displacement by the particle's own pressure", 3)
DIAGONAL = Field("diagonal", "kg/(m^3 Pa)", "a_ii of the pressure equation")
ADVECTED_DENSITY = Field("advected_density", "kg/m^3 (kg/m^2 in 2D)", "density without pressure forces, rho_adv")
PAIR_DISPLACEMENT = Field(
    "pair_displacement", "m", "s_i = sum_j d_ij p_j: displacement by the neighbours' pressures", 3
)
DENSITY_ERROR = Field("density_error", "kg/m^3 (kg/m^2 in 2D)", "compression that the pressures leave")
NEW_PRESSURE = Field("new_pressure", "Pa", "pressure after one more Jacobi step")
WORK = (OWN_DISPLACEMENT, DIAGONAL, ADVECTED_DENSITY, PAIR_DISPLACEMENT, DENSITY_ERROR, NEW_PRESSURE)


class Implicit(NamedTuple):
    """Parameters of the solver as the kernels take them."""

    relaxation: float  # omega
    tolerance: float  # mean compression allowed, as a share of rho0
    least: int  # iterations
    most: int  # iterations
    least_diagonal: float  # 1e-6 of -a_ii/dt^2 on the lattice [kg/(m^3 Pa s^2)]


class ImplicitPressure(Effect, SumsDensity, frozen=True, kw_only=True):
    """Pressure of an incompressible liquid; replaces that of weakly_compressible.

    relaxation  omega of the Jacobi iteration; the paper's 0.5 holds for about 40 neighbours, with 70 it diverges
    tolerance   mean compression at which the iteration ends, as a share of rho0
    iterations  least and largest number of iterations
    courant     share of the support radius that the fastest particle may cross in a step
    """

    name: ClassVar[str] = "iisph"
    host_in_step: ClassVar[bool] = True
    virial: ClassVar[str] = "it is the pressure of the liquid, which balances"
    sums: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)
    replaced: ClassVar[tuple[str, ...]] = ("sph.state", "sph.pressure", "sph.momentum")

    relaxation: Positive = 0.25
    tolerance: Positive = 1e-3
    iterations: tuple[Count, Count] = (2, 100)
    courant: Positive = 0.2

    def check(self, grid: Discretisation, others: Others) -> None:
        least, most = self.iterations
        if most < least:
            raise InputError(f"{self.name}: iterations = [{least}, {most}] is not possible; let the second be larger.")

    def passes(self, others: Others) -> tuple[Pass, ...]:
        names = {"smoothing": "gradient_smoothing"}
        changed = ("pressure", "acceleration")
        solve = Pass("iisph.solve", writes=WORK, updates=changed, names=names, stage="motion", fields=(PRESSURE,))
        liquid = liquid_of(others)
        if liquid.dynamic_viscosity == 0 or liquid.central():  # weakly_compressible lists that pass
            return (solve,)
        return (Pass("sph.viscosity", updates=("acceleration",), names=names), solve)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        fluid = liquid_of(others)
        kernel = smoothing(SETS[fluid.kernels][1], grid.support_radius, grid.dim)
        _, distance = lattice_neighbours(grid.support_radius, grid.spacing, grid.dim)
        squares = float((kernel_slope(distance, kernel) ** 2).sum())
        diagonal = (fluid.particle_mass(grid) / fluid.rest_density) ** 2 * squares
        real = grid.real
        return fluid.prepare(grid, others) | {
            "implicit": Implicit(
                real(self.relaxation), real(self.tolerance), int32(self.iterations[0]), int32(self.iterations[1]),
                real(1e-6 * diagonal),
            ),
        }  # fmt: skip

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        return {"courant": StepLimit.crossing(self.courant * grid.support_radius)}
