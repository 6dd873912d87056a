"""Heat conduction between particles (Shao & Song 2017, M(4)), with latent heat.

A scheme is one pass in the motion of a step: it takes temperatures over the step's length at the positions of the
step's start. Other effects read the field `temperature`, and `enthalpy` if there is latent heat. An effect that melts
particles changes their `conductivity`, `heat_capacity` and `mass` if the materials differ, and no other field.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Literal

import numpy as np

from refsim.core.capabilities import Balance, FollowsSettings, HasErrata, KeepsBalance, KeepsLedger, KnowsParticleMass
from refsim.core.checked import NotNegative, Positive, Printed
from refsim.core.effect import Discretisation, Effect, Field, InitialState, Others, Pass, StepLimit, int32
from refsim.core.errors import InputError
from refsim.heat import shapes
from refsim.heat.reference import temperature_of
from refsim.sph import LIQUID, liquid_of

ABSOLUTE_ZERO = -273.15
MOST_PLANNED = 20.0  # largest k dt/(rho c d^2) for which a GPU finds the number of passes by itself
LONGEST = 1e9  # k dt/(rho c d^2)
KEEPS_RANGE = 3.0  # k dt/(rho c d^2) up to which RKL1 on enthalpies overshoots nowhere, not even beside a reservoir
# Share of the range of temperatures by which a run may leave it. The error of a solve is below a thousandth; a run
# that diverges grows without bound, so that a generous share only delays its end by a few steps.
BEYOND = {"implicit": 0.1, "runge_kutta_legendre": 1.0}
BEYOND_OTHERS, BEYOND_LITERAL = 0.01, 1.0  # schemes that keep the range to rounding; printed ones that do not
ROUNDINGS = 4096  # of the largest temperature, by which a run may leave the range
ANY_TEMPERATURE = 1e30  # [deg C] if another effect heats
CROWDED = 3.0  # largest s_i over that of the lattice for which a GPU has enough passes
TEMPERATURE = Field("temperature", "deg C", "temperature T", state=True)
OF_ENTHALPY = "enthalpy", "heat_capacity", "melting_point", "latent_heat"  # from which a temperature follows
ENTHALPY = Field("enthalpy", "J/kg", "specific enthalpy H, 0 for solid at the melting point", state=True)
HEAT_CAPACITY = Field("heat_capacity", "J/(kg K)", "specific heat c", state=True)
CONDUCTIVITY = Field("conductivity", "W/(m K)", "heat conductivity k", state=True)
MELTING_POINT = Field("melting_point", "deg C", "melting point Tm", state=True)
LATENT_HEAT = Field("latent_heat", "J/kg", "latent heat of melting L", state=True)
RESERVOIR = Field("reservoir", "-", "1 where the temperature is held", dtype="uint8", state=True)
EXCHANGE_RATE = Field("exchange_rate", "1/s", "s_i/dt: sum of exchanges over the heat capacity")
TEMPERATURE_RANGE = Field(
    "temperature_range", "deg C", "lowest and highest temperature that conduction from the start's may reach",
    rows=2, state=True,
)  # fmt: skip
VOLUME = Field("volume", "m^3 (m^2 in 2D)", "volume V = m/rho")
COMPENSATION_X = Field("compensation_x", "-", "xx, xy, xz of A_i, which makes up for missing neighbours", 3, state=True)
COMPENSATION_REST = Field("compensation_rest", "-", "yy, yz, zz of A_i", 3, state=True)

PerPart = float | tuple[float, ...]


class HeatConduction(
    Effect, KnowsParticleMass, FollowsSettings, KeepsLedger, KeepsBalance, HasErrata, frozen=True, kw_only=True
):
    """Conducts heat between all particles within the support radius, liquid or solid.

    "Each part": one number for all, one for each solid and then each part of the fluid, or one for each particle.

    temperature    at the start [deg C]; each part
    conductivity   k [W/(m K)]; each part
    heat_capacity  specific heat c [J/(kg K)]; each part
    melting_point  Tm [deg C], required with latent heat; each part
    latent_heat    L [J/kg], 0 for none anywhere; each part
    held           parts whose temperature is held, by number from 0: reservoirs of heat
    density        of the lattice's particles [kg/m^3] in a scene without a liquid that gives them their mass
    scheme         "implicit" (backward Euler, solved by Chebyshev's iteration), "runge_kutta_legendre" (second order;
                   the most accurate), "explicit", and the paper's "one_sided" (M(4), each particle by itself)
    largest_number  k dt/(rho c d^2) that a step may reach; it limits the step, a fixed one must keep to it; "explicit"
                   and "runge_kutta_legendre" with latent heat are also limited by the particles' own sums s_i
    mean           "harmonic" or "arithmetic" (as in M(4)) mean of two conductivities
    tolerance      share of its error that Chebyshev's iteration leaves
    largest_drift  share of the heat that can be exchanged by which the total may change before the run stops as
                   `heat_lost`, if nothing enters or leaves; 0 for any ("one_sided" loses heat by design)
    literal        readings of Shao & Song: misprints "M5" (Laplacian of poly6, negative for near pairs), "M9"
                   (temperature differences before the sweep); their own choices "M6" (Laplacian of the viscosity
                   kernel, not halved: twice the diffusivity), "M8" (both sweeps of M(4) over the whole step), "M11"
                   (conductivity is a diffusivity [m^2/s], no heat capacity), "M26" (nothing makes up for neighbours
                   that are missing, as always with scheme "one_sided"); "paper" for their own choices, with scheme
                   "one_sided", the arithmetic mean and any drift of the heat; "all" for every printed text
    """

    name: ClassVar[str] = "heat_conduction"
    periodic: ClassVar[bool] = True
    removed: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("single_pass", "nonlinear_jacobi", "pair_exchange", "conjugate_gradient"), "implicit"
    )
    ledger_units: ClassVar[Mapping[str, str]] = {"heat": "J"}
    ledger_expected: ClassVar[Mapping[str, str]] = {
        "heat": "conduction keeps it to rounding; reservoirs and a melt that changes its mass do not"
    }
    balanced: ClassVar[str] = "heat"
    stops_as: ClassVar[str] = "heat_lost"
    remedy: ClassVar[str] = "take another scheme, a shorter step or float64, or raise largest_drift"
    source: ClassVar[str] = "Shao & Song"
    errata: ClassVar[tuple[str, ...]] = ("M5", "M6", "M8", "M9", "M11", "M26")
    improvements: ClassVar[tuple[str, ...]] = ("M6", "M8", "M11", "M26")
    paper: ClassVar[Mapping[str, Any]] = {"scheme": "one_sided", "mean": "arithmetic", "largest_drift": 0.0}

    temperature: PerPart = 20.0
    conductivity: PerPart = 0.6
    heat_capacity: PerPart = 4186.0
    melting_point: PerPart | None = None
    latent_heat: PerPart = 0.0
    held: tuple[int, ...] = ()
    density: Positive = 1000.0
    scheme: Literal["implicit", "runge_kutta_legendre", "one_sided", "explicit"] = "implicit"
    largest_number: Positive = 10.0
    mean: Literal["harmonic", "arithmetic"] = "harmonic"
    tolerance: Positive = 4e-3
    largest_drift: NotNegative = 0.01
    literal: Printed = ()

    @property
    def host_in_step(self) -> bool:  # type: ignore[override]
        """Whether the number of passes is found on the host, so that a GPU step cannot be one graph."""
        long = self.scheme == "implicit" and self.largest_number > MOST_PLANNED
        return self.conducts and (long or self.scheme == "runge_kutta_legendre")

    @property
    def conducts(self) -> bool:
        """Whether any part conducts; if none does, temperatures do not change."""
        return bool(np.any(np.asarray(self.conductivity) > 0))

    @property
    def melts(self) -> bool:
        """Whether there is latent heat, so that the enthalpy is the state."""
        return bool(np.any(np.asarray(self.latent_heat) > 0))

    @property
    def compensates(self) -> bool:
        """Whether pairs make up for neighbours that are missing."""
        return self.conducts and self.scheme != "one_sided" and not self.printed() & {"M5", "M6", "M26"}

    def check(self, grid: Discretisation, others: Others) -> None:
        warm = (lambda v: v >= ABSOLUTE_ZERO, f"a temperature above {ABSOLUTE_ZERO} deg C")
        some = (lambda v: v >= 0, "zero or a positive number")
        more = (lambda v: v > 0, "a positive number")
        rules = {"temperature": warm, "conductivity": some, "heat_capacity": more, "latent_heat": some}
        for name, (test, expected) in (rules | {"melting_point": warm}).items():
            given = getattr(self, name)
            if given is None:
                continue
            if np.size(given) == 0:
                raise InputError(f"{self.name}: {name} is an empty list; give a number, or one for each substance.")
            for value in np.atleast_1d(np.asarray(given, dtype=float)):
                if not (math.isfinite(value) and test(value)):
                    raise InputError(f"{self.name}: {name} = {value} is not possible; give {expected}.")
        if self.tolerance >= 1 or self.largest_number > LONGEST:
            raise InputError(
                f"{self.name}: tolerance is a share of an error, and a longer step than largest_number = {LONGEST:g} is"
                " all rounding; give a tolerance below 1 and a smaller number."
            )
        if self.melts and self.melting_point is None:
            raise InputError(f"{self.name}: latent_heat is given without a melting_point; give both, or neither.")
        printed = self.printed()
        if self.melts and "M11" in printed:
            raise InputError(
                f"{self.name}: with literal Shao & Song M11 there is no heat capacity and no latent heat; drop one."
            )
        if "M5" in printed and self.scheme not in ("one_sided", "explicit"):
            raise InputError(
                f"{self.name}: with literal Shao & Song M5 some pairs conduct from cold to warm, and scheme"
                f" {self.scheme!r} cannot solve that; choose one_sided or explicit."
            )
        if self.melts and self.scheme == "one_sided":
            able = "implicit, runge_kutta_legendre, explicit"
            raise InputError(f"{self.name}: scheme = {self.scheme!r} has no latent heat; choose one of {able}.")
        number = self._fixed_number(grid, others)
        if number > self.largest_number * (1 + 1e-6) and self.scheme != "explicit":
            raise InputError(
                f"{self.name}: the fixed step of {grid.step} s is k dt/(rho c d^2) = {number:.3g}, beyond"
                f" largest_number = {self.largest_number}; take a shorter step, or raise it if accuracy matters less."
            )

    def fields(self, others: Others) -> tuple[Field, ...]:
        fields = [TEMPERATURE, HEAT_CAPACITY]
        if self.melts:
            fields += [ENTHALPY, MELTING_POINT, LATENT_HEAT]
        if self.held:
            fields.append(RESERVOIR)
        if not self.conducts:
            return tuple(fields)
        fields += [CONDUCTIVITY, TEMPERATURE_RANGE]
        if self.compensates:
            fields += [COMPENSATION_X, COMPENSATION_REST]
        if self._limited_by_sums():
            fields.append(EXCHANGE_RATE)
        if not self._volume_is_given(others):
            fields.append(VOLUME if LIQUID in others else dataclasses.replace(VOLUME, state=True))
        return tuple(fields)

    def _volume_is_given(self, others: Others) -> bool:
        rest = (e for e in others.values() if e.name not in (self.name, LIQUID))  # the liquid asks this effect, too
        return any(f.name == "volume" for e in rest for f in e.fields(others))

    def passes(self, others: Others) -> tuple[Pass, ...]:
        if not self.conducts:
            return ()
        updates = ("enthalpy", "temperature") if self.melts else ("temperature",)
        absent = {} if self.melts else dict.fromkeys(("enthalpy", "melting_point", "latent_heat"))
        made = []
        if LIQUID in others and not self._volume_is_given(others):
            made.append(Pass("heat.particle_volume", writes=("volume",)))
        if self.compensates:
            made.append(Pass("heat.compensation", updates=("compensation_x", "compensation_rest")))
        if self._limited_by_sums():
            made.append(Pass("heat.exchange_rate", writes=("exchange_rate",)))
        return (*made, Pass(f"heat.{self.scheme}", updates=updates, names=absent, stage="motion"))

    def list_radius(self, grid: Discretisation) -> float:
        return grid.support_radius if self.conducts else 0.0

    def initial(self, grid: Discretisation, state: InitialState, others: Others) -> Mapping[str, np.ndarray]:
        names = ["temperature", "heat_capacity", *["conductivity"] * self.conducts]
        values = {n: self.of_particles(n, state) for n in (*names, *("melting_point", "latent_heat") * self.melts)}
        if self.melts:
            values["enthalpy"] = enthalpy_of(*(values[n] for n in ("temperature", *OF_ENTHALPY[1:])))
        if self.conducts:
            values["temperature_range"] = np.array([-ANY_TEMPERATURE, ANY_TEMPERATURE])
            if not {"temperature", "enthalpy"} & self._changed_by(others):
                values["temperature_range"] = self._range(values.__getitem__, grid.dtype)
        if self.held:
            values["reservoir"] = self._reservoir(state)
        if self.conducts and not self._volume_is_given(others) and LIQUID not in others:
            values["volume"] = np.full(grid.count, grid.spacing**grid.dim)
        return values

    def _changed_by(self, others: Others) -> set[str]:
        """Fields that other effects change."""
        effects = (effect for effect in others.values() if effect.name != self.name)
        return {name for effect in effects for p in effect.passes(others) for name in (*p.writes, *p.updates)}

    def after_setting(self, name: str, field: Callable[[str], np.ndarray]) -> Mapping[str, np.ndarray]:
        if name in ("position", "volume") and self.compensates:  # begin anew
            return {part: np.zeros_like(field(part)) for part in ("compensation_x", "compensation_rest")}
        made: dict[str, np.ndarray] = {}
        if name not in ("temperature", *OF_ENTHALPY):
            return made
        if self.melts:
            temperature, (enthalpy, *others) = field("temperature"), (field(n).astype(float) for n in OF_ENTHALPY)
            before, melting_point = temperature_of(enthalpy, *others), others[1]
            if name == "temperature":  # what stays at the melting point keeps what has melted of it
                rounding = np.finfo(temperature.dtype).eps * (np.abs(melting_point) + np.abs(before - melting_point))
                stays = np.abs(temperature - before) <= 4 * rounding
                made["enthalpy"] = np.where(stays, enthalpy, enthalpy_of(temperature, *others))
            else:
                made["temperature"] = before
        if self.conducts and float(field("temperature_range")[1]) < 0.5 * ANY_TEMPERATURE:
            now = {n: made.get(n, field(n)) for n in ("temperature", *OF_ENTHALPY * self.melts)}
            made["temperature_range"] = self._range(now.__getitem__, str(field("temperature").dtype))
        return made

    def _range(self, field: Callable[[str], np.ndarray], dtype: str) -> np.ndarray:
        """Lowest and highest temperature [deg C] that conduction may reach: the present ones and a scheme's margin.

        A particle that melts may take another heat capacity while it keeps its enthalpy above the melting point; if the
        liquid's is smaller it becomes warmer by their ratio.
        """
        values = [np.asarray(field("temperature"), dtype=float)]
        if self.melts:
            values.append(temperature_of(*(np.asarray(field(name), dtype=float) for name in OF_ENTHALPY)))
        low, high = min(v.min() for v in values), max(v.max() for v in values)
        share = BEYOND.get(self.scheme, BEYOND_OTHERS)
        if self.printed() & {"M5", "M9"}:
            share = BEYOND_LITERAL
        margin = share * (high - low) + ROUNDINGS * np.finfo(dtype).eps * max(abs(low), abs(high))
        if self.melts:
            above = max(high - float(np.min(np.asarray(self.melting_point, dtype=float))), 0.0)
            high += above * (float(np.max(self.heat_capacity)) / float(np.ravel(self.heat_capacity)[-1]) - 1)
        return np.array([low - margin, high + margin])

    def of_particles(self, name: str, state: InitialState) -> np.ndarray:
        """A parameter that may differ from part to part, for every particle in the first order."""
        given = np.asarray(getattr(self, name), dtype=float)
        n = len(state.mass)
        if given.ndim == 0:
            return np.full(n, float(given))
        if given.shape == (len(state.sizes),):
            return np.repeat(given, state.sizes)
        if given.shape == (n,):
            return given
        raise InputError(
            f"{self.name}: {name} has {given.size} numbers for {len(state.sizes)} parts and {n} particles; give one for"
            " all, or for each part, or for each particle."
        )

    def _reservoir(self, state: InitialState) -> np.ndarray:
        count = len(state.sizes)
        for number in self.held:
            if not 0 <= number < count:
                raise InputError(
                    f"{self.name}: held names part {number}, and the scene has {count}; give numbers from 0 to"
                    f" {count - 1}."
                )
        return np.repeat(np.isin(np.arange(count), self.held).astype(np.uint8), state.sizes)

    def conduction(self, grid: Discretisation) -> shapes.Conduction:
        """How pairs exchange heat, as the kernels take it."""
        printed = self.printed()
        laplacian, factor = shapes.SPIKY, 1 / shapes.lattice_moment(grid.support_radius, grid.spacing, grid.dim)
        if printed & {"M5", "M6"}:
            laplacian = shapes.POLY6 if "M5" in printed else shapes.MUELLER
            factor = 1.0 if "M6" in printed else 0.5
        return shapes.conduction_group(
            grid, laplacian=laplacian, factor=factor, tolerance=self.tolerance,
            sweep_share=1.0 if "M8" in printed else 0.5, harmonic=self.mean == "harmonic",
            unit_capacity="M11" in printed, frozen="M9" in printed,
        )  # fmt: skip

    def _fixed_number(self, grid: Discretisation, others: Others) -> float:
        """k dt/(rho c d^2) of a fixed step, 0 without one."""
        return grid.step * self.greatest_diffusivity(grid, others) / grid.spacing**2

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        if not self.conducts:
            return {}
        conduction, passes = self.conduction(grid), 0
        if self.scheme == "implicit" and not self.host_in_step:  # as the longest step takes
            from refsim.heat.stages import chebyshev_passes  # imports Numba, which planning does not need

            number = self._fixed_number(grid, others) or self.largest_number
            passes = chebyshev_passes(CROWDED * number * shapes.lattice_sum(conduction, grid), self.tolerance)
        return {"conduction": conduction._replace(planned_passes=int32(passes))}

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        diffusivity = self.greatest_diffusivity(grid, others)
        if diffusivity == 0:
            return {}
        number, limits = self.largest_number, {}
        if self._limited_by_sums():
            each = shapes.lattice_sum(self.conduction(grid), grid)
            share = 1 / each if self.scheme == "explicit" else KEEPS_RANGE
            number = share if self.scheme == "explicit" else min(number, share)
            limits["exchange"] = StepLimit(share * each, rate_share=1.0)
        return {"conduction": StepLimit.constant(number * grid.spacing**2 / diffusivity), **limits}

    def _limited_by_sums(self) -> bool:
        """Whether the scheme fails above a certain s_i, so that the particles' own sums limit the step."""
        return self.scheme == "explicit" or (self.scheme == "runge_kutta_legendre" and self.melts)

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        limits, end = self.step_limits(grid, others), "limit 'exchange' shortens the step"
        if "exchange" not in limits:
            return ()
        if grid.step > 0:
            end = f"the fixed step of {grid.step:.3g} s is not shortened, and the run may stop"
        return (
            f"{self.name}: scheme {self.scheme!r} keeps temperatures in their range while no particle's sum of"
            f" exchanges s exceeds {limits['exchange'].length:.3g}, on the lattice up to a step of"
            f" {limits['conduction'].length:.3g} s; where particles crowd or store less heat, {end}",
        )

    def greatest_diffusivity(self, grid: Discretisation, others: Others) -> float:
        """Largest k/(rho c) [m^2/s] that any of the materials could have; with Shao & Song M11 the largest k."""
        k = float(np.max(self.conductivity))
        if "M11" in self.printed():
            return k
        density = liquid_of(others).rest_density if LIQUID in others else self.density
        if grid.solids is not None:
            density = min(density, float(np.min(grid.solids.of_bodies("density"))))
        return k / (density * float(np.min(self.heat_capacity)))

    def particle_mass(self, grid: Discretisation) -> float:
        """rho d^dim [kg; kg/m in 2D] of particles on the lattice in a scene without a liquid."""
        return self.density * grid.spacing**grid.dim

    def ledger(self, field: Callable[[str], np.ndarray]) -> dict[str, float]:
        """Heat [J], from 0 deg C or, with latent heat, from solid at the melting point; reservoirs left out."""
        capacity, level = self._stored(field)
        return {"heat": math.fsum(capacity * level)}

    def _stored(self, field: Callable[[str], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """What each particle stores, as capacity times level: m c [J/K] and T, or m [kg] and the enthalpy [J/kg]."""
        names = ("mass", "enthalpy") if self.melts else ("mass", "heat_capacity", "temperature")
        if "M11" in self.printed() and self.conducts:
            names = ("volume", "temperature")
        *factors, level = (np.asarray(field(name), dtype=float) for name in names)
        capacity = functools.reduce(np.multiply, factors)
        if self.held:
            no_reservoir = field("reservoir") == 0
            capacity, level = capacity[no_reservoir], level[no_reservoir]
        return capacity, level

    def is_closed(self, grid: Discretisation, others: Others) -> bool:
        """No reservoir, and no other effect changes temperatures or what particles store."""
        if not self.conducts or self.held:
            return False
        stored = {"temperature", "enthalpy", "heat_capacity", "mass", *(("volume",) * ("M11" in self.printed()))}
        before = {name for p in self.passes(others) if p.stage != "motion" for name in p.written}
        return not stored & (self._changed_by(others) | before)

    def balance(self, field: Callable[[str], np.ndarray]) -> Balance:
        """Heat [J]; that which can be exchanged is half of sum C |T - mean T|, or of sum m |H - mean H|."""
        capacity, level = self._stored(field)
        heat = capacity * level
        mean = float(heat.sum() / capacity.sum())
        spread = 0.5 * float((capacity * np.abs(level - mean)).sum())
        return Balance(float(heat.sum()), float(np.abs(heat).sum()), spread)


def enthalpy_of(
    temperature: np.ndarray, heat_capacity: np.ndarray, melting_point: np.ndarray, latent_heat: np.ndarray
) -> np.ndarray:
    """H(T) [J/kg]: solid up to and at the melting point, liquid above."""
    above = temperature > melting_point
    return heat_capacity * (temperature - melting_point) + np.where(above, latent_heat, 0.0)
