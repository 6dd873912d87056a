"""Weakly compressible SPH: density, state, pressure, viscosity, leap-frog (Jiang & Zhu 2023, (7) to (11))."""

import functools
import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

import msgspec
import numpy as np

from refsim.core.capabilities import (
    BalancesCohesion,
    BringsWalls,
    CorrectsPositions,
    FindsSurface,
    FollowsGrid,
    FollowsScene,
    HasErrata,
    HasPlanes,
    JudgesStart,
    KnowsLimits,
    KnowsParticleMass,
    LimitsMassRatio,
    LimitsSpeed,
    Margin,
    PullsParticles,
    ReturnsDensity,
    SumsDensity,
    effects_with,
    open_axis,
)
from refsim.core.checked import NotNegative, Positive, Printed, Share
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass, StepLimit, int32
from refsim.core.errors import InputError
from refsim.core.walls import WallParticles
from refsim.smoothing import lattice, smoothing
from refsim.smoothing.reference import kernel_slope, kernel_value
from refsim.sph.flow import at_least, fast_flow
from refsim.sph.resting_start import depths
from refsim.sph.shear import delivered

LIQUID = "weakly_compressible"  # name of the effect that brings the liquid
DETECTION = "surface_detection"  # name of the effect that finds its surface
LIQUID_ALONE = {"phase": None, "rest_density": None}  # names of `sph.continuity` where there are no solids
DENSITY = Field("density", "kg/m^3 (kg/m^2 in 2D)", "density rho, J(7)")
NUMBER_DENSITY = Field("number_density", "1/m^3 (1/m^2 in 2D)", "number density delta, J(8)")
ASYMMETRY = Field("asymmetry", "1/m^2 (1/m in 2D)", "length of the first moment of J(8), |sum_j W_ij x_ij|")
DENSITY_EXCESS = Field("density_excess", "kg/m^3 (kg/m^2 in 2D)", "density over the rest density, rho - rho0")
ADVANCED_EXCESS = Field(
    "advanced_excess", "kg/m^3 (kg/m^2 in 2D)", "rho - rho0 at the end of the step before", state=True
)
VOLUME_BEFORE = Field("volume_before", "m^3 (m^2 in 2D)", "volume m/rho at the end of the step before")
BORNE = Field("borne", "-", "from 0 where liquid fell a step before to 1 where something bore its weight", state=True)
SHIFT = Field("shift", "m", "displacement of a step beside dt v", 3, state=True)  # for the next density
WAY = Field("way", "-", "displacement of a step beside dt v, over the longest that its body may take", 3)
LONGEST_SHIFT = Field("longest_shift", "m", "longest displacement of a step beside dt v, of each body", rows="bodies")
FILLING = Field("filling", "-", "share of space that the told volumes fill, 1 on a lattice and less at a surface")
SUMMED_DENSITY = Field("summed_density", "kg/m^3 (kg/m^2 in 2D)", "density J(7), beside an advanced one")
PRESSURE = Field("pressure", "Pa", "pressure p, J(9)")
OWN_PRESSURE = Field("own_pressure", "Pa", "pressure of a particle in its own force, -p where p < 0 inside")
CORRECTION_DIAGONAL = Field("correction_diagonal", "-", "diagonal of the matrix B of the renormalised gradients", 3)
CORRECTION_MIXED = Field("correction_mixed", "-", "B_xy, B_xz and B_yz", 3)
CORRECTION = (CORRECTION_DIAGONAL.name, CORRECTION_MIXED.name)

# rho0 c h/mu up to which liquid of a summed density was found to gain no energy between walls and in drops, and tanks
# and columns of an advanced one to come to rest (docs/stability.md)
LEAST_VISCOUS = {
    "summation": {"wendland": 250.0, "mueller": 80.0, "cubic_spline": 80.0},
    "continuity": {"wendland": 500.0, "mueller": 250.0, "cubic_spline": 250.0},
}
# Ratio of the largest to the smallest mass up to which a heavy particle in a block gains less than 1 % of the energy
# exchanged (docs/stability.md). Beyond it J(7) makes its neighbours too dense, and J(10) is not the gradient of their
# energy.
MASS_RATIO = 1.5
# `restoring` of free drops: from 0.1 to 0.3 discs of R = 8 d keep their density to 0.4 % and their jump to 10 %;
# without it they crowd by 7 % in five capillary times (tests/surface_tension/test_models.py), with CALM by 2 %
RESTORING = 0.3
# beside shifting: after a splash 998 of 1,001 kg/m^3 are counted, 902 without; waves are damped by less than 0.01 a
# period more (docs/liquid.md)
SLOW = 0.003
CARRIED = 0.95  # share of the weight, below which a tank of an advanced density falls with 0.05 g and more
CALM = 0.01  # most of `restoring` with which tanks rest: in 8 steps 6 % of the speed of a fall, with 0.03 16 %
DIFFUSION = 0.1  # delta, by default
# delta up to which the acoustic step 0.4 h/c resolves diffusion: its fastest rate is 28 delta c/h
MOST_DIFFUSIVE = 0.17
DENSE, CROWD = 1.1, 1e-3  # share of the particles that may be denser than DENSE rho0 without a note (docs/sph.md)
SETS = {
    "wendland": ("wendland_c2", "wendland_c2"),
    "mueller": ("poly6", "spiky"),
    "cubic_spline": ("cubic_spline", "cubic_spline"),
}


class Fluid(NamedTuple):
    """Parameters of the equation of state, the pressure force and the walls in kernels."""

    rest_density: float  # [kg/m^dim]
    stiffness: float  # rho0 c^2 / g [Pa]
    exponent: int  # g
    clamp: int  # 1: negative pressures become zero
    internal_pressure: float = 0.0  # P_int [Pa] of the effects' cohesion, balanced in the bulk
    gradient_share: float = 1.0  # factor of the pressure gradient in J(10); 1/2 as printed (Jiang & Zhu E24)
    wall_share: float = 2.0  # wall pressure over the particle's, summed: 2 for p_b = p_i, 1 for patent P6


class DensityBounds(NamedTuple):
    """Densities of a compressed liquid, in times the rest density, as the kernels take them."""

    rest_density: float  # [kg/m^dim], where a particle has none of its own
    dense: float  # above which a particle counts for a note
    crushed: float  # above which it counts for a stop


class ViscosityTerm(NamedTuple):
    """Parameters of the viscous term in kernels."""

    coefficient: float  # dynamic viscosity [Pa s]; negative for the printed sign of J(11)


class Diffusion(NamedTuple):
    """Parameters of the diffusion of the density in kernels."""

    coefficient: float  # delta h_s c [m^2/s], h_s = h/2
    stretch: float  # rho0/c^2 [kg s^2/m^(dim + 2)]: times g, the slope of the density at rest
    release: float = 0.0  # rate c/h at which a lone particle gives off its pressure [1/s]


class Recount(NamedTuple):
    """Parameters of the filling and of an advanced density's return to the counted one in kernels."""

    rate: float  # [1/s]
    whole: float  # 1/sum_j d^dim W_ij of the lattice [-]


class WallFrameGravity(NamedTuple):
    """Acceleration of gravity as kernels take it, seen from the walls: g - a_w [m/s^2]."""

    x: Any  # [m/s^2]
    y: Any  # [m/s^2]
    z: Any  # [m/s^2]


class CentralViscosity(NamedTuple):
    """Parameters of the viscosity along the line of centres in kernels."""

    coefficient: float  # (dim + 2) mu over what layers feel of it [Pa s]


@functools.lru_cache(maxsize=64)
def lattice_number_density(shape: str, support_radius: float, spacing: float, dim: int) -> float:
    """Sum of W over the infinite square or cubic lattice, self included [1/m^dim]: delta0."""
    distance = lattice_distances(support_radius, spacing, dim)
    return float(kernel_value(distance, smoothing(shape, support_radius, dim)).sum())


def lattice_distances(support_radius: float, spacing: float, dim: int) -> np.ndarray:
    """Distances (n,) [m] of a particle of the infinite lattice to itself and to all within the support."""
    return np.linalg.norm(lattice(math.ceil(support_radius / spacing), dim) * spacing, axis=1)


def central_coefficient(dynamic_viscosity: float, dim: int) -> float:
    """(dim + 2) mu [Pa s]: coefficient of the viscosity along the line of centres for the dynamic viscosity mu [Pa s].

    For v_j - v_i = r (e.grad) v + r^2/2 (e.grad)^2 v + ... at x_j = x_i + r e the force density k sum_j V_j lap W_ij
    (e.(v_j - v_i)) e becomes (k/2) <e_a e_b e_c e_d> d_c d_d v_b int r^2 lap W dV. The mean over directions is
    (d_ab d_cd + d_ac d_bd + d_ad d_bc)/(dim (dim + 2)), and the integral is 2 dim: k/(dim + 2) (lap v + 2 grad div v).
    """
    return (dim + 2) * dynamic_viscosity


def cohesive_pressure(grid: Discretisation, others: Others) -> float:
    """Internal pressure [Pa] of all cohesive effects, as far as the equation of state balances it."""
    return sum(effect.balanced_pressure(grid, others) for effect in effects_with(others, BalancesCohesion))


def pressure_is_replaced(others: Others) -> bool:
    """Whether another effect solves for the pressure in place of the equation of state."""
    return any("sph.state" in effect.replaces() for effect in others.values())


class WeaklyCompressible(
    Effect, KnowsParticleMass, LimitsSpeed, LimitsMassRatio, KnowsLimits, JudgesStart, HasErrata, FollowsGrid,
    FollowsScene, frozen=True, kw_only=True,
):  # fmt: skip
    """Liquid whose pressure follows from its density, advanced or summed.

    rest_density       rho0 [kg/m^3; kg/m^2 in 2D]
    sound_speed        numerical sound speed c [m/s]
    dynamic_viscosity  mu [Pa s]; 0 leaves viscosity out
    artificial_viscosity  alpha [-] of Monaghan 1992, which adds alpha rho0 c h/(4 (dim + 2)) to mu; the finer the
                       spacing, the less
    viscosity          "laplacian" (J(11), along the difference of velocities: it slows down the rotation of a rigidly
                       rotating liquid) or "central" (Espanol & Revenga 2003, along the line of centres: it conserves
                       angular momentum); by default central, and J(11) where density = "summation" or `literal` is
                       given or solids float in a liquid whose density is summed
    state              "linear" (J(9)) or "tait" (exponent 7)
    density            "continuity" (the continuity equation, advanced from step to step) or "summation" (J(7)); by
                       default advanced, and summed where `literal` or another effect of the scene needs it
    diffusion          delta of the diffusion of an advanced density, after Fourtakas et al. 2019; 0 for none
    restoring          rate [c/h] at which an advanced density returns inside the liquid to the counted one, which
                       sees where particles are (after Colagrossi & Landrini 2003); by default 0.003 where shifting acts
                       beside a surface, in free drops of Akinci's calibrated tension 0.5 (h/d)^3 S^(5/4), S =
                       sigma/(rho0 c^2 d), where that is larger; else beside tension 0.01 in a container and 0.3 in
                       free drops; else 0
    gradient           "plain" or "corrected" (renormalised after Bonet & Lok 1999: the pressure force of a lattice is
                       that of the pressure's gradient; it keeps the linear, not the angular momentum)
    tensile_control    p_i + p_j becomes p_j - p_i where p_i < 0 (Sun et al. 2018): "none", "inside" (but at the surface
                       that `surface_detection` finds) or "everywhere" (in a liquid without a surface); it keeps no
                       momentum
    clamp_pressure     negative pressures become zero; by default with a summed density
    kernels            "wendland" (Wendland C2 throughout), "mueller" (poly6 for sums, spiky for gradients) or
                       "cubic_spline" (throughout)
    density_bound      the run stops where more than 0.1 % of the particles are denser than this times rho0
    literal            readings of Jiang & Zhu: misprint "E3" (sign of J(11), unstable); their own choice "E24" (half
                       of the pressure gradient in J(10)); "paper" for their own choices, E24 and
                       clamp_pressure = false, "all" for every printed text
    """

    name: ClassVar[str] = LIQUID
    source: ClassVar[str] = "Jiang & Zhu"
    errata: ClassVar[tuple[str, ...]] = ("E3", "E24")
    improvements: ClassVar[tuple[str, ...]] = ("E24",)
    paper: ClassVar[Mapping[str, Any]] = {"clamp_pressure": False}  # Jiang & Zhu E32: J(9) has no clamp
    in_papers: ClassVar[Mapping[str, str]] = {"density": "summation", "viscosity": "laplacian"}
    sums: ClassVar[bool] = True
    of_liquid: ClassVar[bool] = True
    periodic: ClassVar[bool] = True
    virial: ClassVar[str] = "it is the pressure of the liquid, which balances"

    rest_density: Positive = 1000.0
    sound_speed: Positive
    dynamic_viscosity: NotNegative = 0.0
    artificial_viscosity: NotNegative = 0.0
    viscosity: Literal["laplacian", "central"] | None = None
    state: Literal["linear", "tait"] = "linear"
    density: Literal["summation", "continuity"] | None = None
    diffusion: float = DIFFUSION
    restoring: Share | None = None
    gradient: Literal["plain", "corrected"] = "plain"
    tensile_control: Literal["none", "inside", "everywhere"] = "none"
    clamp_pressure: bool | None = None
    kernels: Literal["wendland", "mueller", "cubic_spline"] = "wendland"
    density_bound: float = 1.5
    literal: Printed = ()

    def in_scene(self, grid: Discretisation) -> "WeaklyCompressible":
        """With the artificial viscosity, alpha times (h/2) c/(2 (dim + 2)) for nu, in the dynamic one."""
        reach = grid.support_radius / (4 * (grid.dim + 2))
        whole = self.dynamic_viscosity + self.artificial_viscosity * self.rest_density * self.sound_speed * reach
        return msgspec.structs.replace(self, dynamic_viscosity=whole, artificial_viscosity=0.0)

    def with_scene_defaults(self, others: Others) -> "WeaklyCompressible":
        standing = stands(others)
        summed = bool(self.literal) or any(
            effect.sums_density(standing) for effect in effects_with(others, SumsDensity)
        )
        density = self.density or ("summation" if summed else "continuity")
        printed = self.density == "summation" or self.literal or (summed and "two_way_coupling" in others)
        viscosity = self.viscosity or ("laplacian" if printed else "central")
        restoring = self.restoring
        if restoring is None:
            restoring = 0.0
            if density == "continuity":
                drifts = any(effect.parts_from_density() for effect in effects_with(others, CorrectsPositions))
                pulled = bool(effects_with(others, PullsParticles))
                restoring = SLOW if drifts else 0.0 if not pulled else CALM if standing else RESTORING
        return msgspec.structs.replace(self, density=density, viscosity=viscosity, restoring=restoring)

    def on_grid(self, given: Any, grid: Discretisation, others: Others) -> "WeaklyCompressible":
        """With the rate of a tension beside it, where `restoring` is not given."""
        if given.restoring is not None or not self.restoring:
            return self
        rate = max((e.return_rate(grid, others) for e in effects_with(others, ReturnsDensity)), default=0.0)
        return msgspec.structs.replace(self, restoring=max(self.restoring, min(rate, RESTORING)))

    def needs(self) -> tuple[str, ...]:
        return (DETECTION,) if self.tensile_control == "inside" else ()

    def check(self, grid: Discretisation, others: Others) -> None:
        if not self.density_bound > DENSE:
            raise InputError(
                f"{self.name}: density_bound = {self.density_bound:g} is not above {DENSE:g}, from which on a run has a"
                " note; give 1.5 or more."
            )
        self._check_density(others)
        axis = open_axis(grid, others)
        if self.tensile_control == "everywhere" and axis:
            raise InputError(
                f"{self.name}: tensile_control = 'everywhere', but the scene is open along {axis}; set tensile_control"
                f" = 'inside' and add the effect {DETECTION}."
            )
        if self.tensile_control != "none" and self.clamps():
            raise InputError(
                f"{self.name}: tensile_control acts on negative pressures, which clamp_pressure sets to zero; leave one"
                " of them out."
            )
        if self.central() and "E3" in self.literal:
            raise InputError(
                f"{self.name}: literal 'E3' is the printed sign of J(11), which viscosity = 'central' does not use;"
                " leave one of them out."
            )

    def _check_density(self, others: Others) -> None:
        """Raise InputError where the density cannot be advanced as it is said to be."""
        if not 0 <= self.diffusion <= MOST_DIFFUSIVE:
            raise InputError(
                f"{self.name}: diffusion = {self.diffusion:g} is not possible; give 0 to {MOST_DIFFUSIVE:g}, above"
                " which the acoustic step is too long for it."
            )
        for key, usual in (("diffusion", DIFFUSION), ("restoring", 0)) if not self.advances() else ():
            if (value := getattr(self, key)) not in (None, 0, usual):
                raise InputError(
                    f"{self.name}: {key} = {value:g} is for an advanced density, and this one is summed; leave it out"
                    ", or set density = 'continuity'."
                )
        walls = effects_with(others, BringsWalls)
        extrapolated = any(effect.extrapolates() for effect in walls)
        if not (self.advances() or extrapolated or self.controls()):
            return
        coupled = ""  # the effect that has passes of its own for an advanced density
        if self.controls():
            what = "gradient = 'corrected'" if self.corrects() else f"tensile_control = {self.tensile_control!r}"
        elif self.advances():
            what, coupled = "density = 'continuity'", "two_way_coupling"
        else:
            what = "walls with model = 'extrapolated'"
        for effect in others.values():
            replaced = sorted({"sph.density", "sph.state", "sph.pressure", "sph.momentum"} & set(effect.replaces()))
            if replaced and effect.name != coupled:
                why = f"which replaces {replaced[0]}"
                if self.controls() and effect.name == "two_way_coupling":
                    why = "whose solids bear the opposite of plain pair forces"
                raise InputError(
                    f"{self.name}: {what} and {effect.name}, {why}, exclude each other; leave one of them out."
                )
            if isinstance(effect, BringsWalls) and not effect.extrapolates():
                raise InputError(
                    f"{self.name}: {what} needs an extrapolated pressure at all walls; set model = 'extrapolated' in"
                    f" {effect.name}, too."
                )

    def advances(self) -> bool:
        """Whether its density follows from the continuity equation."""
        return self.density == "continuity"

    def leans(self, others: Others) -> bool:
        """Whether the diffusion of its density knows a slope at rest."""
        return self.diffusion > 0 and stands(others)

    def corrects(self) -> bool:
        """Whether its pressure force has renormalised gradients."""
        return self.gradient == "corrected"

    def controls(self) -> bool:
        """Whether its pressure force is another than J(10)."""
        return self.corrects() or self.tensile_control != "none"

    def clamps(self) -> bool:
        """Whether negative pressures become zero."""
        return not self.advances() if self.clamp_pressure is None else self.clamp_pressure

    def central(self) -> bool:
        """Whether the viscosity is not zero and acts along the line of centres."""
        return self.viscosity == "central" and self.dynamic_viscosity > 0

    def fields(self, others: Others) -> tuple[Field, ...]:
        fields = (DENSITY, *(() if pressure_is_replaced(others) else (PRESSURE,)), *self._own_fields(others))
        summed = (SUMMED_DENSITY,) if self._sums_wanted(others) else ()
        if not self.advances():
            return (*fields, *summed) if "two_way_coupling" in others else fields  # whose density counts no particles
        borne = (BORNE,) if self.leans(others) else ()
        return (*fields, DENSITY_EXCESS, ADVANCED_EXCESS, VOLUME_BEFORE, *borne, *summed)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        viscous = self.dynamic_viscosity > 0
        names: dict[str, str | None] = {"smoothing": "gradient_smoothing"}
        friction = Pass("sph.central_viscosity", updates=("acceleration",), names=names)
        walls = [effect.extrapolates() for effect in effects_with(others, BringsWalls)]
        replaced = any("sph.pressure" in effect.replaces() for effect in others.values())
        stated = () if self.advances() else (Pass("sph.state", writes=("pressure",)),)
        before = (*self._density_passes(others), *stated)
        if self.viscosity == "central" and all(walls) and not (replaced or self.controls()):
            names |= volumes(others)
            if self.advances() or not self.central():
                names |= dict.fromkeys(("velocity", "central_viscosity"))
            return (*before, Pass("sph.central_momentum", updates=("acceleration",), names=names))
        plain = Pass(
            "sph.momentum" if viscous and not self.central() else "sph.pressure",
            updates=("acceleration",),
            names=names | ({"walls": None} if any(walls) else {}),
        )
        return (
            *before,
            *(self._controlled(others) if self.controls() else (plain,)),
            *((friction,) if self.central() and not self.advances() else ()),
        )

    def _own_fields(self, others: Others) -> tuple[Field, ...]:
        """Fields of the renormalised gradients and of the tensile control."""
        corrected = (CORRECTION_DIAGONAL, CORRECTION_MIXED) if self.corrects() else ()
        pressure = () if self.tensile_control == "none" else (OWN_PRESSURE,)
        near = surface_of(others).near_passes() if self.tensile_control == "inside" else ()
        return (*corrected, *pressure, *(made for p in near for made in p.fields))

    def _controlled(self, others: Others) -> Iterator[Pass]:
        """The passes of a pressure force with renormalised gradients or tensile control, and of J(11)."""
        names: dict[str, str | None] = {"smoothing": "gradient_smoothing"}
        if self.corrects():
            yield Pass("sph.gradient_correction", writes=CORRECTION, names=names)
        if self.tensile_control == "inside":
            yield from surface_of(others).near_passes()
            yield Pass("sph.own_pressure", writes=("own_pressure",))
        elif self.tensile_control == "everywhere":
            yield Pass("sph.own_pressure", writes=("own_pressure",), names={"near_surface": None})
        yield self.with_own_force("sph.corrected_pressure", names, "own_pressure")
        if self.dynamic_viscosity > 0 and not self.central():
            yield Pass("sph.viscosity", updates=("acceleration",), names=names)

    def with_own_force(self, operation: str, names: Mapping[str, str | None], own: str) -> Pass:
        """A pass of the pressure force with its correction and, as argument `own`, each particle's own pressure."""
        left_out = {} if self.corrects() else dict.fromkeys(CORRECTION)
        pressure = "pressure" if self.tensile_control == "none" else "own_pressure"
        renamed = {} if own == pressure else {own: pressure}
        return Pass(operation, updates=("acceleration",), names={**names, **left_out, **renamed})

    def _sums_wanted(self, others: Others) -> bool:
        """Whether an effect needs a sum of J(8), which an advanced density does without."""
        if self.tensile_control == "inside":
            return True
        rest = (effect for effect in others.values() if effect is not self)
        return any(f in (NUMBER_DENSITY, ASYMMETRY) for effect in rest for f in effect.fields(others))

    def _density_passes(self, others: Others) -> tuple[Pass, ...]:
        if not self.advances():
            return (Pass("sph.density", writes=("density", "number_density", "asymmetry")),)
        leans = self.leans(others)
        kept = Pass(
            "sph.keep_density", updates=("advanced_excess", *(("borne",) if leans else ())), stage="motion",
            names={} if leans else dict.fromkeys(("acceleration", "lean", "borne")),
        )  # fmt: skip
        return (*continuity_passes(others, LIQUID_ALONE), *self.summed_passes(others), kept)

    def summed_passes(self, others: Others) -> tuple[Pass, ...]:
        """J(7) and J(8) beside a density that is advanced or another effect's, where an effect needs them."""
        if not self._sums_wanted(others):
            return ()
        written = ("summed_density", "number_density", "asymmetry")
        return (Pass("sph.density", writes=written, names={"density": "summed_density"}),)

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        return (*self._braked(grid, others), *self._restless(grid, others), *self.exceeded(grid, others))

    def _restless(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Notes on a fast return to the counted density, which is not even up to walls and surface, and on kernels
        whose lattice does not carry the weight."""
        if stands(others) and self.advances() and (self.restoring or 0.0) > CALM:
            yield (
                f"{self.name}: with restoring = {self.restoring:g} liquid in a container does not stay at rest; give"
                f" {CALM:g} or less"
            )
        # the share of a pressure's even gradient, and so of the weight, that the sum over the lattice gives
        r = lattice_distances(grid.support_radius, grid.spacing, grid.dim)
        slope = kernel_slope(r, smoothing(SETS[self.kernels][1], grid.support_radius, grid.dim))
        carried = -self.particle_volume(grid) * float((r * slope).sum()) / grid.dim
        if stands(others) and carried < CARRIED and self.gradient == "plain" and not pressure_is_replaced(others):
            yield (
                f"{self.name}: in the lattice the sums of kernels = {self.kernels!r} at h ="
                f" {grid.support_radius / grid.spacing:.3g} d carry {carried:.1%} of the weight: liquid in a container"
                " does not stay at rest, and its pressure becomes too high by the rest; take other kernels or a wider"
                " support_radius"
            )

    def notes_on_start(
        self, grid: Discretisation, state: InitialState, walls: WallParticles | None, others: Others
    ) -> Iterator[str]:
        if "iisph" not in others:  # whose pressure follows from no sound speed
            pull, advice = acceleration_of(others), lambda sound: at_least("sound_speed", sound, "m/s")
            yield from fast_flow(self.name, self.sound_speed, advice, grid, state, walls, others, pull)

    def _braked(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Note on the loss of angular momentum by J(11) in a liquid without walls."""
        summed = not any("sph.density" in effect.replaces() for effect in others.values())  # its forces act
        held = bool(effects_with(others, BringsWalls))
        if self.dynamic_viscosity == 0 or self.central() or not summed or held or grid.count == 0:
            return
        radius = grid.spacing * math.sqrt(grid.count / math.pi)
        if grid.dim == 3:
            radius = grid.spacing * (3 * grid.count / (4 * math.pi)) ** (1 / 3)
        factor = {2: 4, 3: 5}[grid.dim]
        rate = factor * self.dynamic_viscosity / (self.rest_density * radius**2)
        yield (
            f"{self.name}: viscosity J(11) brakes free rotation: a drop of all {grid.count} particles (R = {radius:.3g}"
            f" m) loses angular momentum at up to {factor} nu/R^2 = {rate:.3g} per second; viscosity = 'central'"
            " conserves it"
        )

    def _largest_number(self) -> float:
        """rho0 c h/mu up to which the liquid is known to behave, see LEAST_VISCOUS."""
        return LEAST_VISCOUS["continuity" if self.advances() else "summation"][self.kernels]

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        if not pressure_is_replaced(others):
            least = self.rest_density * self.sound_speed * grid.support_radius / self._largest_number()
            risk = "water may not come to rest" if self.advances() else "kinetic energy may grow at walls and in drops"
            notes = (
                f"with a viscosity of {self.dynamic_viscosity:g} Pa s, below rho0 c h/{self._largest_number():g} ="
                f" {least:.3g} Pa s, {risk}: increase the viscosity, or monitor the energy"
            )
            yield Margin("dynamic_viscosity [Pa s]", self.dynamic_viscosity, least, least=True, beyond=notes)

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        """Density of liquid at rest: that of the pressure rho0 g depth where the liquid stands on a wall.

        Its particles have the mass of that density, so that they are as large as the lattice's cells; not those to
        which the scene gives a mass.
        """
        if not self.advances():
            return {}
        excess = np.zeros(grid.count)
        pull = np.array(acceleration_of(others))
        strength = float(np.linalg.norm(pull))
        if strength > 0:
            down, exponent = pull / strength, 7 if self.state == "tait" else 1
            bodies = 0 if grid.solids is None else len(grid.solids.bodies)
            ends = np.cumsum([0, *state.sizes])
            parts = [state.position[a:b] for a, b in itertools.pairwise(ends[bodies:])]
            depth = depths(
                parts, grid.spacing, down, lambda x: self._stands(x, down, grid, others),
                lambda x: _covered(x, state.position[: ends[bodies]], grid, others),
            )  # fmt: skip
            ratio = 1 + strength * depth * exponent / self.sound_speed**2
            excess[ends[bodies] :] = self.rest_density * (ratio ** (1 / exponent) - 1)
        usual = np.isclose(state.mass, self.particle_mass(grid), rtol=1e-12, atol=0.0)
        mass = np.where(usual, state.mass * (1 + excess / self.rest_density), state.mass)
        borne = {BORNE.name: (excess > 0).astype(float)} if self.leans(others) else {}
        return {ADVANCED_EXCESS.name: excess, "mass": mass, **borne}

    def _stands(self, x: np.ndarray, down: np.ndarray, grid: Discretisation, others: Others) -> bool:
        """Whether liquid at x (n, 3) [m] stands on a plane or on other walls' particles, a spacing below at most."""
        for effect in effects_with(others, HasPlanes):
            lower, upper = effect.domain(grid)
            apart = np.where(down < 0, x.min(0) - lower, upper - x.max(0))
            if (apart < grid.spacing)[down != 0].all():
                return True
        foot = x[np.argmax(x @ down)] + grid.spacing * down
        return any(effect.filled(grid, foot[None])[0][0] > 0 for effect in effects_with(others, BringsWalls))

    def largest_mass_ratio(self, others: Others) -> float:
        summed = not any("sph.density" in effect.replaces() for effect in others.values())
        return MASS_RATIO if summed else math.inf

    def greatest_speed(self, grid: Discretisation) -> float:
        """Ten times the sound speed [m/s]; weak compressibility assumes at most a tenth of the sound speed."""
        return 10 * self.sound_speed

    def sum_kernel(self) -> str:
        """Name of the smoothing kernel of all summations."""
        return SETS[self.kernels][0]

    def rest_number_density(self, grid: Discretisation) -> float:
        """delta0, the number density of the undisturbed lattice [1/m^dim]."""
        return lattice_number_density(self.sum_kernel(), grid.support_radius, grid.spacing, grid.dim)

    def particle_mass(self, grid: Discretisation) -> float:
        """m = rho0/delta0 [kg; kg/m in 2D], so that the interior of a lattice has exactly the rest density.

        rho0 d^dim where the density is advanced, from the rest density on.
        """
        return self.rest_density * self.particle_volume(grid)

    def particle_volume(self, grid: Discretisation) -> float:
        """1/delta0 [m^dim]; d^dim where the density is advanced."""
        return grid.spacing**grid.dim if self.advances() else 1 / self.rest_number_density(grid)

    def shares(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        sums, gradients = SETS[self.kernels]
        exponent = 7 if self.state == "tait" else 1
        # how many times the particle's pressure wall particles push with: the least of all walls
        share = min((e.wall_share for e in effects_with(others, BringsWalls)), default=BringsWalls.wall_share)
        return {
            "smoothing": smoothing(sums, grid.support_radius, grid.dim, grid.dtype),
            "gradient_smoothing": smoothing(gradients, grid.support_radius, grid.dim, grid.dtype),
            "fluid": Fluid(
                grid.real(self.rest_density), grid.real(self.rest_density * self.sound_speed**2 / exponent),
                int32(exponent), int32(self.clamps()), grid.real(cohesive_pressure(grid, others)),
                grid.real(0.5 if "E24" in self.printed() else 1.0), grid.real(share),
            ),
            "density_bounds": DensityBounds(*map(grid.real, (self.rest_density, DENSE, self.density_bound))),
        }  # fmt: skip

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        sign = -1.0 if "E3" in self.printed() else 1.0
        viscous = self.dynamic_viscosity > 0 and not self.central()
        near = surface_of(others).near_groups(grid, others) if self.tensile_control == "inside" else {}
        return {
            **near,
            **(self.spreading(grid, others) if self.advances() else {}),
            "viscosity": ViscosityTerm(grid.real(sign * self.dynamic_viscosity)) if viscous else None,
            **(self.central_friction(grid) if self.central() else {"central_viscosity": None}),
        }

    def central_friction(self, grid: Discretisation) -> dict[str, Any]:
        """Parameter group of the viscosity along the line of centres."""
        return {"central_viscosity": CentralViscosity(grid.real(self.line_viscosity(grid)))}

    def line_viscosity(self, grid: Discretisation) -> float:
        """(dim + 2) mu [Pa s], of a viscosity along the line of centres over what sliding layers feel of it."""
        coefficient = central_coefficient(self.dynamic_viscosity, grid.dim)
        if not self.central():
            return coefficient
        filled = self.particle_volume(grid) / grid.spacing**grid.dim
        return coefficient / (filled * delivered(grid.support_radius / grid.spacing, grid.dim))

    def spreading(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        """Parameter groups of an advanced density: of its diffusion and of its return to the counted one."""
        recount = None
        if self.restoring or finds_filling(others):
            rest = lattice_number_density(SETS[self.kernels][1], grid.support_radius, grid.spacing, grid.dim)
            rate = (self.restoring or 0.0) * self.sound_speed / grid.support_radius
            recount = Recount(grid.real(rate), grid.real(1 / (rest * grid.spacing**grid.dim)))
        coefficient = 0.5 * self.diffusion * grid.support_radius * self.sound_speed
        stretch = self.rest_density / self.sound_speed**2 if self.leans(others) else 0.0
        release = self.sound_speed / grid.support_radius
        diffusion = Diffusion(*map(grid.real, (coefficient, stretch, release))) if self.diffusion else None
        return {"diffusion": diffusion, "recount": recount, **lean(grid, others)}

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        stiffening = 2 * cohesive_pressure(grid, others) / self.rest_density
        sound_speed = math.sqrt(self.sound_speed**2 + stiffening)
        limits: dict[str, StepLimit] = {}
        if not pressure_is_replaced(others):
            limits["acoustic"] = StepLimit.crossing(0.4 * grid.support_radius, sound_speed)
        if self.dynamic_viscosity > 0:
            half = 0.5 * grid.support_radius
            # Along the line of centres waves of compression decay with 3 mu k^2/rho: mu (lap v + 2 grad div v).
            stiffer = 3.0 if self.central() else 1.0
            seconds = 0.125 * half**2 * self.rest_density / self.dynamic_viscosity
            limits["viscous"] = StepLimit.constant(seconds / stiffer)
        return limits


def _covered(x: np.ndarray, solid: np.ndarray, grid: Discretisation, others: Others) -> np.ndarray:
    """Which of the places (n, 3) [m] lie in solids, whose particles are at `solid` (m, 3) [m], or in walls."""
    covered = np.zeros(len(x), bool)
    for effect in effects_with(others, BringsWalls):
        covered |= effect.filled(grid, x)[0] > 0.5
    if len(solid):
        from scipy.spatial import cKDTree

        covered |= cKDTree(solid).query(x)[0] < 0.75 * grid.spacing
    return covered


def volumes(others: Others) -> dict[str, str | None]:
    """Names of what sums over the liquid's volumes read; beside a tension, which reads masses and densities, those."""
    if liquid_of(others).advances() and not effects_with(others, PullsParticles):
        return {"volume": VOLUME_BEFORE.name, "density": None}
    return {"volume": "mass"}


def continuity_passes(others: Others, names: Mapping[str, str | None]) -> tuple[Pass, Pass]:
    """The passes that advance the density; walls, where there are any, are those of `adami_2012`."""
    filling = ("filling",) if finds_filling(others) else ()
    viscous, leans = ("acceleration",) * liquid_of(others).central(), liquid_of(others).leans(others)
    walls = effects_with(others, BringsWalls)
    there = {
        "wall_normal": walls, "wall_strain": walls, "borne": leans, "turning": leans, "filling": filling,
        "acceleration": viscous,
        "shift": any(SHIFT in effect.fields(others) for effect in others.values()),
    }  # fmt: skip
    left_out = {name: None for name, found in there.items() if not found}
    names = {"smoothing": "gradient_smoothing", "volume": VOLUME_BEFORE.name, **names, **left_out}
    return (
        Pass("sph.volume", writes=(VOLUME_BEFORE.name,), names=names),
        Pass("sph.continuity", writes=(*viscous, *filling, "pressure", "density_excess", "density"), names=names),
    )


def finds_filling(others: Others) -> bool:
    """Whether an effect reads the filling, by which it knows what is near a surface."""
    return any(FILLING in effect.fields(others) for effect in others.values() if effect.name != LIQUID)


def liquid_of(others: Others) -> WeaklyCompressible:
    """The scene's liquid; an effect that takes it has LIQUID among its needs."""
    return others[LIQUID]  # type: ignore[return-value]


def surface_of(others: Others) -> FindsSurface:
    """The effect that finds the liquid's surface; an effect that takes it has DETECTION among its needs."""
    return others[DETECTION]  # type: ignore[return-value]


class Gravity(Effect, frozen=True, kw_only=True):
    """Uniform acceleration of all particles.

    acceleration  g [m/s^2], along x or y in 2D; left out, 9.81 along -z, in 2D along -y
    """

    name: ClassVar[str] = "gravity"
    scales: ClassVar[tuple[str, ...]] = ("acceleration",)
    periodic: ClassVar[bool] = True

    acceleration: tuple[float, float, float] | None = None

    def in_scene(self, grid: Discretisation) -> "Gravity":
        downwards = (0.0, -9.81, 0.0) if grid.dim == 2 else (0.0, 0.0, -9.81)
        return self if self.acceleration else msgspec.structs.replace(self, acceleration=downwards)

    def acts(self) -> bool:
        return True  # motions of the frame add to it

    def check(self, grid: Discretisation, others: Others) -> None:
        if grid.dim == 2 and acceleration_of(others)[2] != 0:
            raise InputError("gravity: acceleration has a z part in a 2D scene; point it along x or y.")

    def passes(self, others: Others) -> tuple[Pass, ...]:
        return (Pass("sph.gravity", updates=("acceleration",)),) if any(acceleration_of(others)) else ()

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        return {"field": np.array(acceleration_of(others), dtype=grid.dtype)}


def gravity_of(others: Others) -> Gravity | None:
    """The scene's gravity, if it has any."""
    return others.get(Gravity.name)  # type: ignore[return-value]


def stands(others: Others) -> bool:
    """Whether gravity presses liquid on walls."""
    gravity = gravity_of(others)
    pulled = gravity is not None and (gravity.acceleration is None or any(gravity.acceleration))
    return pulled and bool(effects_with(others, BringsWalls))


def lean(grid: Discretisation, others: Others) -> dict[str, WallFrameGravity]:
    """Parameter group of gravity as walls at rest see it, for `Effect.prepare`."""
    return {"lean": WallFrameGravity(*map(grid.real, acceleration_of(others)))}


def acceleration_of(others: Others) -> tuple[float, float, float]:
    """The acceleration of gravity of a scene that is planned [m/s^2]; zero without one."""
    gravity = gravity_of(others)
    return (gravity and gravity.acceleration) or (0.0, 0.0, 0.0)
