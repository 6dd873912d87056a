"""Two-way coupling of liquid and solid particles through pressure and viscosity (Shao & Song 2017, (1) to (3))."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from refsim import sph
from refsim.core.capabilities import HasErrata, LimitsMassRatio, SumsDensity
from refsim.core.checked import Printed
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass, StepLimit, int32
from refsim.core.errors import InputError
from refsim.shape_matching import PHASE

# Largest ratio of particle masses for which the energy rises no more than with equal masses (docs/stability.md): of
# solids in a liquid, the largest measured; of liquids that melting has produced
MASS_RATIO, LIQUIDS_RATIO = 1000.0, 10.0
REST_DENSITY = Field("rest_density", "kg/m^3", "rest density rho0 of the particle's substance", state=True)
VOLUME = Field("volume", "m^3 (m^2 in 2D)", "volume V = m/rho")
RELATIVE_CONTRIBUTION = Field(
    "relative_contribution", "-", "weight in Shao & Song (1): 1 in liquid, phi at a solid's surface, 0 inside solids"
)


SOLID_NUMBER = Field(
    "solid_number", "-", "number of the particle's solid, from 1; 0 in the liquid", dtype="int32", state=True
)
WET = Field("wet", "-", "sum of W over the liquid near a solid's particle, over W(0); a quarter of that beside it")
SUCTION = Field("suction", "Pa", "least pressure of a film, below 0, where it breaks")
FILM_FACTOR = Field("film_factor", "-", "times which films too thin for particles push")
ALLOWED_CLOSENESS = Field("allowed_closeness", "-", "how close others may be to a solid's particle", state=True)
CONTACT_PRESSURE = Field("contact_pressure", "Pa", "what presses bodies apart that overlap")
PLANE_PRESSURE = Field("plane_pressure", "Pa", "the same of planes across x, y and z", 3)
FILM = WET, SUCTION, FILM_FACTOR, ALLOWED_CLOSENESS, CONTACT_PRESSURE, PLANE_PRESSURE
TOLD_WET = Field("told_wet", "-", "wetness of solids in the step before", state=True)
TOLD_PRESSURE = Field("told_pressure", "Pa", "pressure in the step before", state=True)
TOLD_SUCTION = Field("told_suction", "Pa", "suction in the step before", state=True)
TOLD = TOLD_WET, TOLD_PRESSURE, TOLD_SUCTION
FOLLOWED_VELOCITY = Field(
    "followed_velocity", "m/s", "velocity that follows the particle's; their difference is the acceleration of solids",
    3, state=True,
)  # fmt: skip
DRAWN = 1e3  # above all, before the first step: what overlaps as drawn is not pressed apart
PASSED = 0.25  # of its wetness that a solid's particle passes on
STIFFNESS, DAMPED = 0.005, 1.0  # of what overlaps [rho0 c^2], and of how fast [h/c]
DELAY = 4.0  # of the followed velocity [h/c]


class Delay(NamedTuple):
    """What smooths the acceleration of solids, as the kernels take it."""

    tau: float  # [s]


class Overlapping(NamedTuple):
    """What presses bodies apart that overlap, as the kernels take it."""

    inverse_spacing: float  # 1/d [1/m]
    inverse_volume: float  # 1/d^dim [1/m^dim]
    stiffness: float  # [Pa]
    delay: float  # by which the growth of an overlap counts [s]


class Coupling(NamedTuple):
    """Two-way coupling as the kernels take it."""

    least_volume: float  # V_min, the volume of a liquid particle in the undisturbed bulk [m^dim]
    stiffness: float  # c^2/g of Tait's equation [m^2/s^2]
    exponent: int  # exponent g of Tait's equation [-]
    printed_volume: int  # V_k from the particles at surfaces alone (Shao & Song M4)
    printed_pressure: int  # (2) without one m_i (Shao & Song M2)
    printed_viscosity: int  # (3) without one V_i (Shao & Song M3)
    density_weighted: int  # pairs of liquid have a common pressure, weighted by densities


def delay(grid: Discretisation, liquid: sph.WeaklyCompressible) -> float:
    """tau of the followed velocity [s]."""
    return DELAY * grid.support_radius / liquid.sound_speed


def told_at_start(grid: Discretisation, state: InitialState, others: Others) -> dict[str, np.ndarray]:
    """Wetness [-], pressure [Pa] and u [m/s] of solids' particles at the start, from particle to particle within h.

    Liquid that stands on no wall has no pressure and falls; so does what it wets, with a_k = g and u = v - tau g.
    """
    from scipy.spatial import cKDTree

    liquid = sph.liquid_of(others)
    solids = 0 if grid.solids is None else len(grid.solids.lattice.body)
    wet, pressure = np.zeros(grid.count), np.zeros(grid.count)
    excess = liquid.initial(grid, state, others)["advanced_excess"]
    pressure[solids:] = liquid.sound_speed**2 * excess[solids:]
    falls, pull = excess == 0, np.array(sph.acceleration_of(others))
    left, known, weight = np.arange(solids), np.arange(solids, grid.count), 1.0
    while len(left) and len(known):
        apart, near = cKDTree(state.position[known]).query(state.position[left])
        found, way = left[apart < grid.support_radius], known[near[apart < grid.support_radius]]
        head = np.where(falls[way], 0.0, (state.position[found] - state.position[way]) @ pull)
        wet[found], pressure[found] = weight, pressure[way] + liquid.rest_density * head
        falls[found] = falls[way]
        left, known, weight = left[apart >= grid.support_radius], found, PASSED * weight
    pressure[solids:] = 0.0
    u = state.velocity - np.where((wet > 0) & falls, delay(grid, liquid), 0.0)[:, None] * pull
    return {"told_wet": wet, "told_pressure": pressure, "followed_velocity": u}


class TwoWayCoupling(Effect, LimitsMassRatio, HasErrata, SumsDensity, frozen=True, kw_only=True):
    """Pressure and viscous forces between liquid and solids; replaces the liquid's own density and forces.

    The liquid may consist of several substances: every particle has its own rest density, that of the scene's liquid or
    of the solid that it has melted from. Kernels, sound speed, equation of state and viscosity are those of
    `weakly_compressible`, whose negative pressures must be clamped.

    With the liquid's density = "continuity" solids take the pressure that is extrapolated from the liquid to their
    particles (Adami et al. 2012) with the acceleration of their motion, and push back with the opposite force; the
    liquid is one substance then, and its viscosity the central one.

    no_slip           liquid is held at solids: between both acts twice the viscosity, the harmonic mean of mu and an
                      infinite one; without it liquid slips past them as if they began 0.6 spacings deeper
    density_weighted  a pair of liquid particles has the common pressure (rho_j p_i + rho_i p_j)/(rho_i + rho_j), not
                      two (Hu & Adams 2007): for substances of very different density
    literal           errata of Shao & Song taken as printed: "M2" ((2) without one m_i), "M3" ((3) without one V_i),
                      "M4" (V_k from the particles at surfaces alone); or "all". They are misprints and a gap, so that
                      "paper" changes nothing
    """

    name: ClassVar[str] = "two_way_coupling"
    source: ClassVar[str] = "Shao & Song"
    virial: ClassVar[str] = "it is the pressure of liquid and solids, which balances"
    errata: ClassVar[tuple[str, ...]] = ("M2", "M3", "M4")
    sums: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (sph.LIQUID, "shape_matching")
    replaced: ClassVar[tuple[str, ...]] = (
        "sph.density", "sph.volume", "sph.continuity", "sph.state", "sph.pressure", "sph.momentum",
    )  # fmt: skip

    no_slip: bool = False
    density_weighted: bool = False
    literal: Printed = ()

    def sums_density(self, standing: bool) -> bool:
        return self.density_weighted or bool(self.literal)

    def check(self, grid: Discretisation, others: Others) -> None:
        if sph.cohesive_pressure(grid, others) > 0:
            raise InputError(f"{self.name}: an effect with cohesion treats particles of solids as liquid; remove it.")
        liquid = sph.liquid_of(others)
        if self.no_slip and not (liquid.advances() and liquid.dynamic_viscosity > 0):
            raise InputError(
                f"{self.name}: no_slip needs a liquid with viscosity whose density is advanced; give {liquid.name} a"
                " dynamic_viscosity and density = 'continuity', or leave no_slip out."
            )
        if liquid.advances():
            self._check_advanced(liquid, others)
            return
        if not liquid.clamps():
            raise InputError(
                f"{self.name}: negative pressures would make solids stick to the liquid; set clamp_pressure = true in"
                " weakly_compressible."
            )
        if liquid.central():
            raise InputError(
                f"{self.name}: its viscous force is Shao & Song (3), not along the line of centres; leave viscosity of"
                " weakly_compressible at 'laplacian', or set density = 'continuity'."
            )

    def _check_advanced(self, liquid: sph.WeaklyCompressible, others: Others) -> None:
        if "melting" in others and others["melting"].sums_density(False):  # type: ignore[attr-defined]
            raise InputError(
                f"{self.name}: a liquid with density = 'continuity' has one rest density, and melting brings another;"
                " set its bookkeeping = 'water', or leave one of them out."
            )
        if self.density_weighted or self.printed():
            raise InputError(
                f"{self.name}: density_weighted and literal belong to a summed density; leave them out with density ="
                " 'continuity'."
            )
        if liquid.dynamic_viscosity > 0 and not liquid.central():
            raise InputError(
                f"{self.name}: with density = 'continuity' the viscosity of {liquid.name} acts on solids, too, and"
                " 'laplacian' would brake their rotation; set viscosity = 'central'."
            )

    def fields(self, others: Others) -> tuple[Field, ...]:
        if sph.liquid_of(others).advances():
            return (sph.DENSITY, sph.PRESSURE, REST_DENSITY, PHASE, SOLID_NUMBER, FOLLOWED_VELOCITY, *FILM, *TOLD)
        return (sph.DENSITY, sph.PRESSURE, REST_DENSITY, PHASE, RELATIVE_CONTRIBUTION, VOLUME)

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        rest_density = np.full(grid.count, sph.liquid_of(others).rest_density)
        number = np.zeros(grid.count, np.int32)
        if grid.solids is not None:
            densities = grid.solids.of_bodies("density")
            rest_density[: len(densities)] = densities
            number[: len(densities)] = 1 + grid.solids.lattice.body
        if not sph.liquid_of(others).advances():
            return {"rest_density": rest_density}
        told = told_at_start(grid, state, others)
        told |= {"rest_density": rest_density, "solid_number": number}
        return told | {"allowed_closeness": np.full(grid.count, DRAWN)}

    def passes(self, others: Others) -> tuple[Pass, ...]:
        liquid = sph.liquid_of(others)
        if liquid.advances():
            return self._advanced_passes(liquid.summed_passes(others), others)
        viscous = liquid.dynamic_viscosity > 0
        return (
            *liquid.summed_passes(others),
            Pass("two_way_coupling.contribution", writes=("relative_contribution",)),
            Pass("two_way_coupling.density", writes=("density", "pressure", "volume")),
            Pass(
                "two_way_coupling.forces" if viscous else "two_way_coupling.pressure",
                updates=("acceleration",),
                names={"smoothing": "gradient_smoothing"},
            ),
        )

    def _advanced_passes(self, summed: tuple[Pass, ...], others: Others) -> tuple[Pass, ...]:
        names = {"smoothing": "gradient_smoothing"}
        return (
            *sph.continuity_passes(others, {}),
            *summed,
            Pass("two_way_coupling.extrapolation", writes=("wet", "suction"), updates=("pressure",)),
            Pass("two_way_coupling.spread", updates=("wet", "suction", "pressure")),
            Pass("two_way_coupling.overlap", updates=("allowed_closeness",), writes=tuple(f.name for f in FILM[4:])),
            Pass("two_way_coupling.close_films", writes=("film_factor",), names=names),
            Pass("two_way_coupling.push", updates=("acceleration",), names=names),
            Pass("two_way_coupling.contact", updates=("acceleration",)),
            *((Pass("two_way_coupling.hold", updates=("acceleration",), names=names),) if self.no_slip else ()),
            Pass(
                "two_way_coupling.follow",
                updates=("followed_velocity",),
                writes=tuple(f.name for f in TOLD),
                stage="motion",
            ),
        )

    def largest_mass_ratio(self, others: Others) -> float:
        return LIQUIDS_RATIO if "melting" in others else MASS_RATIO

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        liquid = sph.liquid_of(others)
        if liquid.advances():
            friction = liquid.central_friction(grid) if liquid.central() else {"central_viscosity": None}
            overlap = (
                1 / grid.spacing, 1 / grid.spacing**grid.dim, STIFFNESS * liquid.rest_density * liquid.sound_speed**2,
                DAMPED * grid.support_radius / liquid.sound_speed,
            )  # fmt: skip
            own = {"delay": Delay(grid.real(delay(grid, liquid))), "overlapping": Overlapping(*map(grid.real, overlap))}
            return own | friction | liquid.spreading(grid, others) | sph.lean(grid, others)
        printed = self.printed()
        exponent = 7 if liquid.state == "tait" else 1
        viscous = liquid.dynamic_viscosity > 0
        return {
            "coupling": Coupling(
                grid.real(1 / liquid.rest_number_density(grid)), grid.real(liquid.sound_speed**2 / exponent),
                int32(exponent), int32("M4" in printed), int32("M2" in printed), int32("M3" in printed),
                int32(self.density_weighted),
            ),
            "viscosity": sph.ViscosityTerm(grid.real(liquid.dynamic_viscosity)) if viscous else None,
        }  # fmt: skip

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        liquid = sph.liquid_of(others)
        limits = {"acoustic": StepLimit.crossing(0.4 * grid.support_radius, liquid.sound_speed)}
        if liquid.dynamic_viscosity > 0 and grid.solids is not None:
            lightest = min([liquid.rest_density, *(body.density for body in grid.solids.bodies)])
            seconds = 0.125 * (0.5 * grid.support_radius) ** 2 * lightest / liquid.dynamic_viscosity
            limits["viscous"] = StepLimit.constant(seconds / (3 * (1 + self.no_slip)) if liquid.central() else seconds)
        return limits
