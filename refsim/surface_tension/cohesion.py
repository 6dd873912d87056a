"""Models with a central pair force F_ij = m_i m_j C(r) e_ij, where C > 0 repels.

Cohesion between all pairs causes an internal pressure P_int in the bulk, many times the jump 2 sigma/R (sigma/R in 2D)
at the surface. The equation of state can balance it by a term P_int (rho/rho0)^2; the bulk is then at rest at rho0.
Without this term a linear equation of state balances P_int by compression: rho/rho0 = s with Pi s^2 - s + 1 = 0 and
Pi = P_int/(rho0 c^2), which has no solution for Pi > 1/4: the liquid collapses.
"""

import functools
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim.core.capabilities import (
    BalancesCohesion,
    BringsWalls,
    CorrectsPositions,
    FollowsScene,
    HasTension,
    KnowsLimits,
    Margin,
    PullsParticles,
    ReturnsDensity,
    effects_with,
)
from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Effect, Others, Pass, StepLimit
from refsim.core.errors import InputError
from refsim.smoothing import lattice_neighbours, smoothing
from refsim.smoothing.reference import kernel_slope
from refsim.sph import LIQUID, SETS, acceleration_of, liquid_of, pressure_is_replaced, stands
from refsim.sph.flow import at_least

SIGMA = "surface_tension"  # name of the parameter that every model has
COLLAPSE = 0.25  # Pi beyond which no density balances the cohesion
# S = sigma/(rho0 c^2 d) up to which the middle of small drops keeps the rest density to 10 % (docs/models.md)
KEEPS_DENSITY = 0.01
FLAT = 10.0  # Bond number of a drawn body, by the radius of its ball, from which on contact angles hardly shape it
STRAINED = 0.045  # Pi at which the bulk is compressed by 5 %, from which on a note warns
DENSITY_KEPT = "small drops keep their density to 10 %"
BECAME_DROPS = "cubes became drops (beyond it they fly apart, and a shorter step does not help)"
# For a sharp surface and g(r) = 1 (Kirkwood & Buff 1949), by dimension: power of r in the moment of C, and its factor
# beside rho0^2. Tension [N/m] 3D -(pi/8) rho0^2 int r^4 C dr, 2D -(1/3) rho0^2 int r^3 C dr; cohesive pressure [Pa] of
# the bulk, positive compresses, 3D -(2 pi/3) rho0^2 int r^3 C dr, 2D -(pi/2) rho0^2 int r^2 C dr.
TENSION = {2: (3, -1 / 3), 3: (4, -math.pi / 8)}
PRESSURE = {2: (2, -math.pi / 2), 3: (3, -2 * math.pi / 3)}
FASTEST_RETURN = 0.3  # rate [c/h] beyond which the density of no free drop returns
Table = Mapping[int, Any]
PairForce = Callable[[NDArray], NDArray]  # C(r) [N/kg^2] of distances r [m]


@functools.cache
def _quadrature() -> tuple[NDArray, NDArray]:
    """Nodes and weights of Gauss."""
    return np.polynomial.legendre.leggauss(16)


def force_moment(force: PairForce, power: int, support_radius: float) -> float:
    """Integral of r^power C(r) dr from 0 to h, by Gauss quadrature in 60 pieces."""
    node, weight = _quadrature()
    edge = np.linspace(0.0, support_radius, 61)
    half = 0.5 * np.diff(edge)[:, None]
    r = 0.5 * (edge[1:] + edge[:-1])[:, None] + half * node
    return float((half * weight * r**power * force(r)).sum())


def of_all_pairs(
    of: Mapping[int, tuple[int, float]], force: PairForce, rest_density: float, h: float, dim: int
) -> float:
    """TENSION [N/m] or PRESSURE [Pa] of a pair force between all particles within h [m]."""
    power, factor = of[dim]
    return math.prod((factor, rest_density**2, force_moment(force, power, h)))


def over_lattice(force: PairForce, power: int, grid: Discretisation) -> float:
    """sum_j r_j^power C(r_j) over a particle's neighbours on the infinite lattice within the support."""
    _, r = lattice_neighbours(grid.support_radius, grid.spacing, grid.dim)
    return float((r**power * force(r)).sum())


def compression(number: float) -> float:
    """rho/rho0 at which the linear equation of state balances the cohesion, s = (1 - sqrt(1 - 4 Pi))/(2 Pi).

    number  Pi = P_int/(rho0 c^2), at most 1/4; NaN beyond
    """
    if number > COLLAPSE:
        return math.nan
    return 2 / (1 + math.sqrt(1 - 4 * number))


def _between(table: Any, support: float, place: float) -> float:
    """What drops have at h/d and at the logarithm of another place: linear between them, and that of the nearest."""
    supports, lines = zip(*table, strict=True)
    values = [np.interp(math.log(place), *np.array([(math.log(at), value) for at, value in line]).T) for line in lines]
    return float(np.interp(support, supports, values))


class Drops(NamedTuple):
    """Drops with which the tension of a model was measured, in containers or `free`: a table of drops.toml."""

    free: bool  # the density returns by `rate`
    measured: Table  # where it has nothing, sigma is nominal
    by_radius: Table
    radii: Table
    held: float = 0.0
    beyond: str = ""
    on_walls: str = ""
    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)


@functools.cache
def tables_of(model: str) -> Mapping[str, Any]:
    """Its tables of drops.toml by their names."""
    import tomllib  # here: importing refsim does without

    return tomllib.loads(Path(__file__).with_name("drops.toml").read_text(encoding="utf-8")).get(model, {})


@functools.cache
def drops_of(model: str, free: bool = False) -> Drops:
    """The drops of a model by its name; tables by dimension."""
    given = tables_of(model).get("free" if free else "contained", {})
    named = ("measured", "by_radius", "radii")
    by_dimension = {name: {int(dim): rows for dim, rows in given.get(name, {}).items()} for name in named}
    return Drops(free, **{**given, **by_dimension})


class MeasuredByDrops(ReturnsDensity, FollowsScene):
    """What a model has whose tension in the default liquid is that of measured drops."""

    name: ClassVar[str]

    def with_scene_defaults(self: Any, others: Others) -> Any:
        """Corrections of the density at a surface, left out, are on but where it is complete there."""
        left_out = [name for name in self.in_papers if getattr(self, name) is None]
        if not left_out:
            return self
        return msgspec.structs.replace(self, **dict.fromkeys(left_out, not density_complete_at_surface(others)))

    def share_of_nominal(self, grid: Discretisation, others: Others) -> float:
        """Measured over nominal tension in the default liquid, whose particles are shifted; else 1.

        Linear in h/d, log S and log R/d between what was measured, R that of the scene's smallest body of liquid, and
        at the nearest beyond.
        """
        stiffness, dim = self._measured_at(grid, others), grid.dim
        if stiffness is None:
            return 1.0
        support, radius = (length / grid.spacing for length in (grid.support_radius, grid.drop_radius))
        drops = self._drops(grid, others)
        share = _between(drops.measured[dim], support, stiffness)
        if not (radius and dim in drops.by_radius):
            return share
        radii, tables = zip(*drops.by_radius[dim], strict=True)
        factors = [_between(table, support, stiffness) for table in tables]
        return share * float(np.interp(math.log(radius), np.log(radii), factors))

    def keeps_drops(self) -> bool:
        return bool(drops_of(self.name).measured) and self == self._plain()

    def _plain(self) -> Any:
        """The model with nothing but its tension given, as in the drops that were measured."""
        return type(self)(**{SIGMA: getattr(self, SIGMA)})

    def _as_measured(self, others: Others) -> bool:
        """Whether model and kernels are those of the drops that were measured."""
        return self == self._plain().with_scene_defaults(others) and liquid_of(others).kernels == "wendland"

    def _measured_at(self, grid: Discretisation, others: Others) -> float | None:
        """S = sigma/(rho0 c^2 d), where the coefficient follows from measured drops."""
        liquid, sigma = liquid_of(others), getattr(self, SIGMA)
        complete = density_complete_at_surface(others) and grid.dim in self._drops(grid, others).measured
        if not (sigma and complete and self._as_measured(others)):
            return None
        return sigma / (liquid.rest_density * liquid.sound_speed**2 * grid.spacing)

    def _drops(self, grid: Discretisation, others: Others) -> Drops:
        """Whose maps hold: those of free drops, or where gravity presses on walls of those in containers."""
        free = grid.dim in drops_of(self.name, free=True).measured and not stands(others)
        return drops_of(self.name, free)

    def return_rate(self, grid: Discretisation, others: Others) -> float:
        """That of the measured drops, which follows S and h/d."""
        stiffness, (factor, of_support, power) = self._measured_at(grid, others), self._drops(grid, others).rate
        if stiffness is None:
            return 0.0
        return min(FASTEST_RETURN, factor * (grid.support_radius / grid.spacing) ** of_support * stiffness**power)

    def beyond_measured(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Notes on a tension that no drop of the liquid has shown, and on one in a setting of no such drop.

        An S is beyond those of the drops by more than a tenth.
        """
        complete = density_complete_at_surface(others)
        if not getattr(self, SIGMA) or (liquid_of(others).with_scene_defaults(others).advances() and not complete):
            return
        stiffness, support = self._measured_at(grid, others), grid.support_radius / grid.spacing
        if stiffness is None:
            reason = "no drops of this liquid were measured with it"
            nominal = tables_of(self.name).get("nominal", {}).get("continuity" if complete else "summation", {})
            if str(grid.dim) in nominal and self._as_measured(others) and not pressure_is_replaced(others):
                jump, frequency = nominal[str(grid.dim)]
                reason = (
                    f"drops of this liquid have {jump} of it by their pressure jump, {frequency} by their frequency;"
                    f" with {'akinci_2013' if grid.dim == 3 else 'csf_wang_2019'} it is what acts"
                )
            elif not complete:
                reason = "calibrate has the coefficient where drops of a summed density were measured"
            yield f"{self.name}: surface_tension is nominal: {reason}"
            return
        whose = self._drops(grid, others)
        supports, drops = zip(*[at for at in whose.measured[grid.dim] if at[0] >= whose.held], strict=True)
        begin = f"{self.name}: surface_tension is that of drops measured with"
        reach = " to ".join(f"{h:g}" for h in dict.fromkeys((supports[0], supports[-1])))
        if not supports[0] - 0.01 <= support <= supports[-1] + 0.01:
            yield (
                f"{begin} a support_radius of {reach} spacings; with {support:.3g} another tension acts{whose.beyond}"
            )
        radius = grid.drop_radius / grid.spacing
        small, large, others_have = whose.radii.get(grid.dim, (0, math.inf, ""))
        if radius and not 0.95 * small <= radius <= 1.05 * large:
            yield f"{begin} a radius of {small:g} to {large:g} spacings, to 5 %; with {radius:.3g} {others_have}"
        least, most = (float(np.interp(support, supports, [d[k][0] for d in drops])) for k in (0, -1))
        if not least / 1.1 <= stiffness <= most * 1.1:
            yield (
                f"{begin} sigma/(rho0 c^2 d) = {least:.2g} to {most:.2g}; with {stiffness:.2g} a"
                f" {'larger' if stiffness < least else 'smaller'} tension acts"
            )
        weight = liquid_of(others).rest_density * float(np.linalg.norm(acceleration_of(others)))
        walled = any(effect.extrapolates() for effect in effects_with(others, BringsWalls))
        on_walls = drops_of(self.name).on_walls
        if on_walls and radius and walled and weight * grid.drop_radius**2 < FLAT * getattr(self, SIGMA):
            yield (
                f"{self.name}: walls pull this liquid, so that drops have a contact angle of {on_walls} degrees on"
                " them; csf_wang_2019 takes a contact_angle, akinci_2013 has others by calibrate_contact_angle"
            )

    def nominal_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] that the coefficient has in theory."""
        raise NotImplementedError  # a model defines it

    def acting_tension(self, grid: Discretisation, others: Others) -> tuple[float, str]:
        if self._measured_at(grid, others) is None:
            return abs(self.nominal_tension(grid, others)), "nominal"
        return getattr(self, SIGMA), "measured drops"


class PairCohesion(
    Effect, MeasuredByDrops, HasTension, BalancesCohesion, KnowsLimits, PullsParticles, frozen=True, kw_only=True
):
    """Base of the models with pair cohesion, and of every force between particles at rest that is no pressure.

    A model gives `name`, `coefficient_name`, `prepare` and `force_of`. It has from here: the coefficient of a nominal
    tension, internal pressure and its balance, the refusal of a collapse, capillary step limit, energy, and its notes.

    balance_pressure  the equation of state balances the cohesion of the bulk by P_int (rho/rho0)^2 (not in the papers);
                      without it cohesion compresses the liquid, which collapses at P_int = rho0 c^2/4 (linear equation
                      of state)
    surface_tension   sigma [N/m]; nominal: turned into the model's coefficient by the Kirkwood-Buff integral
    """

    lattice: ClassVar[bool] = False  # sums over lattice neighbours, for a force of short range
    sums: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)

    balance_pressure: bool = True
    surface_tension: NotNegative | None = None

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "scales" not in vars(cls):  # a model with more coefficients names them
            cls.scales = (SIGMA, cls.coefficient_name)

    def check(self, grid: Discretisation, others: Others) -> None:
        self.check_coefficients()
        self.check_others(grid, others)
        self.check_collapse(grid, others)

    def check_others(self, grid: Discretisation, others: Others) -> None:
        """Raise InputError where its other parameters are not possible."""

    def passes(self, others: Others) -> tuple[Pass, ...]:
        """The pass of the pair force, where it is all that the model has."""
        return (Pass(f"{self.name}.cohesion", updates=("acceleration",)),)

    def check_coefficients(self) -> None:
        """Raise InputError unless either the tension or the model's own coefficient is given."""
        without = [getattr(self, name) is None for name in (SIGMA, self.coefficient_name)]
        if without[0] == without[1]:
            number = "neither" if all(without) else "both"
            raise InputError(
                f"{self.name}: {number} of {SIGMA} and {self.coefficient_name} given; give exactly one of them."
            )

    def coheres(self) -> bool:
        """Whether the coefficient, given or from sigma, is not zero."""
        given = getattr(self, self.coefficient_name)
        return (getattr(self, SIGMA) if given is None else given) != 0

    def coefficient(self, grid: Discretisation, others: Others) -> float:
        """The model's own coefficient, given or from sigma: measured in the default liquid, else nominal."""
        given, sigma = getattr(self, self.coefficient_name), getattr(self, SIGMA)
        if given is not None:
            return given
        return sigma / self.unit_tension(grid, others) / self.share_of_nominal(grid, others) if sigma else 0.0

    def unit_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] of a coefficient of one."""
        return self._tension_of(lambda r: self.force_of(1.0, r, grid, others), grid, others)

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """C(r) [N/kg^2] of this coefficient at distances r [m] up to h; positive repels."""
        raise NotImplementedError

    def pair_force(self, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """C(r) [N/kg^2] at distances r [m] up to h; positive repels."""
        return self.force_of(self.coefficient(grid, others), r, grid, others)

    def acts_on_all_pairs(self) -> bool:
        """Whether the pair force also acts in the bulk."""
        return True

    def nominal_tension(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] of the pair force by the Kirkwood-Buff integral or lattice sum."""
        return self._tension_of(self._force(grid, others), grid, others)

    def _tension_of(self, force: PairForce, grid: Discretisation, others: Others) -> float:
        """sigma [N/m]; lattice: 3D -(n/32) sum_j r_j^2 f_j, 2D -(n/(6 pi)) sum_j r_j^2 f_j, f = m^2 C, n = rho0/m."""
        fluid = liquid_of(others)
        if self.lattice:
            factor = 1 / 32 if grid.dim == 3 else 1 / (6 * math.pi)
            return -factor * fluid.rest_density * fluid.particle_mass(grid) * over_lattice(force, 2, grid)
        return of_all_pairs(TENSION, force, fluid.rest_density, grid.support_radius, grid.dim)

    def tension_with_balance(self, grid: Discretisation, others: Others) -> float:
        """sigma [N/m] of C(r) - 2 P W'(r)/rho0^2: pair force and balancing pressure, which an advanced density has
        up to the surface; a summed one falls there."""
        fluid, pressure = liquid_of(others), self.balanced_pressure(grid, others)
        kernel, force = smoothing(SETS[fluid.kernels][1], grid.support_radius, grid.dim), self._force(grid, others)
        return self._tension_of(
            lambda r: force(r) - 2 * pressure * kernel_slope(r, kernel) / fluid.rest_density**2, grid, others
        )

    def internal_pressure(self, grid: Discretisation, others: Others) -> float:
        """P_int [Pa] of the pair force in the undisturbed bulk; on the lattice -(n/(2 dim)) sum_j r_j f_j."""
        if not self.acts_on_all_pairs():
            return 0.0
        fluid, force = liquid_of(others), self._force(grid, others)
        if self.lattice:
            share = -fluid.rest_density * fluid.particle_mass(grid) / (2 * grid.dim)
            return share * over_lattice(force, 1, grid)
        return of_all_pairs(PRESSURE, force, fluid.rest_density, grid.support_radius, grid.dim)

    def balanced_pressure(self, grid: Discretisation, others: Others) -> float:
        return max(0.0, self.internal_pressure(grid, others)) if self.balance_pressure else 0.0

    def check_collapse(self, grid: Discretisation, others: Others) -> None:
        """Raise InputError where no density balances the cohesion, P_int > rho0 c^2/4."""
        number, fluid = self.collapse_number(grid, others), liquid_of(others)
        if number >= COLLAPSE:
            needed = fluid.sound_speed * math.sqrt(number / COLLAPSE)
            raise InputError(
                f"{self.name}: the cohesive pressure of {self.internal_pressure(grid, others):.4g} Pa would collapse"
                f" the liquid; give weakly_compressible a sound_speed above {needed:.4g} m/s (10 times that for 1 %"
                " compression), or set balance_pressure = true."
            )

    def collapse_number(self, grid: Discretisation, others: Others) -> float:
        """Pi = P_int/(rho0 c^2) that a linear equation of state balances by compression; 0 if nothing needs to."""
        fluid = liquid_of(others)
        held = self.balance_pressure or fluid.state != "linear"
        if held or pressure_is_replaced(others):
            return 0.0
        return max(0.0, self.internal_pressure(grid, others)) / (fluid.rest_density * fluid.sound_speed**2)

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        notes = [*self.exceeded(grid, others), *self.beyond_measured(grid, others)]
        if liquid_of(others).advances() and not shifted(others) and self.balanced_pressure(grid, others) > 0:
            share = self.tension_with_balance(grid, others) / self._tension_of(self._force(grid, others), grid, others)
            notes.append(
                f"{self.name}: on an advanced density the pressure that balances cohesion acts up to the surface and"
                f" leaves about {share:.2g} of its nominal tension: take the coefficient of calibrate(..., density ="
                " 'continuity')"
            )
        return (*notes, *self.own_notes(grid, others))

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Those of this model alone."""
        return iter(())

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        if (number := self.collapse_number(grid, others)) > 0:
            consequence = (
                f"its cohesion compresses the bulk by about {100 * (compression(number) - 1):.0f} % (P_int"
                f" = {number:.2g} rho0 c^2; beyond {COLLAPSE} the liquid collapses): take a larger sound_speed, or set"
                " balance_pressure = true"
            )
            yield Margin("P_int/(rho0 c^2)", number, STRAINED, beyond=consequence)
        for limit in self.stiffness_limits(grid, others):
            yield from stiffness_margin(*limit, grid, others)

    def stiffness_limits(self, grid: Discretisation, others: Others) -> Iterator[tuple[float, float, str]]:
        """(tension [N/m], its largest S = sigma/(rho0 c^2 d), what holds up to it), where there is tension.

        Not of measured drops, whose own S are in `beyond_measured`.
        """
        sigma, known = self.acting_tension(grid, others)
        if sigma and known == "nominal":
            yield sigma, KEEPS_DENSITY, DENSITY_KEPT

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        return capillary_limit(self.acting_tension(grid, others)[0], grid, others)

    def _force(self, grid: Discretisation, others: Others) -> PairForce:
        return lambda r: self.pair_force(r, grid, others)


def shifted(others: Others) -> bool:
    """Whether particles are shifted beside a surface."""
    return any(effect.parts_from_density() for effect in effects_with(others, CorrectsPositions))


def density_complete_at_surface(others: Others) -> bool:
    """Whether the density is advanced and shifted: at a surface it is not too small, as a summed one is."""
    return shifted(others) and liquid_of(others).with_scene_defaults(others).advances()


def stiffness_margin(sigma: float, largest: float, fate: str, grid: Discretisation, others: Others) -> Iterator[Margin]:
    """S = sigma/(rho0 c^2 d) beside the `largest`, up to which `fate`; nothing where no sound speed acts."""
    fluid = liquid_of(others)
    if not pressure_is_replaced(others):
        value = sigma / (fluid.rest_density * fluid.sound_speed**2 * grid.spacing)
        needed = at_least("sound_speed", fluid.sound_speed * math.sqrt(max(1.0, value / largest)), "m/s")
        consequence = f"sigma/(rho0 c^2 d) = {value:.2g} is above {largest:g}, up to which {fate}: take {needed}"
        yield Margin("sigma/(rho0 c^2 d)", value, largest, beyond=consequence)


def spreading_note(name: str, term: str) -> str:
    """Note on a term along differences of normals without cohesion."""
    return (
        f"{name}: the {term} alone holds no drop together: small drops were found to spread until no particle has a"
        " neighbour, at every coefficient and sound speed; add cohesion, or take another model"
    )


def angular_momentum_note(name: str, term: str, others: Others, direction: str = "") -> Iterator[str]:
    """Note if a term that is not parallel to e_ij alone changes the angular momentum of a free liquid.

    With viscosity J(11), which changes it far more, the note of weakly_compressible says so instead; nor do shifts keep
    it.
    """
    fluid = liquid_of(others)
    if direction == "axial" or shifted(others) or (fluid.dynamic_viscosity > 0 and not fluid.central()):
        return
    remedy = "take area_direction = 'axial', or leave the term out" if direction else "leave the term out"
    how = "with this viscosity" if fluid.central() else "without viscosity"
    yield (
        f"{name}: {how} angular momentum would be conserved, but the {term} does not act along the pair and"
        f" changes it: {remedy} if that matters"
    )


def capillary_limit(sigma: float, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
    """Step limit 0.25 sqrt(rho0 (h/2)^3/(2 pi sigma)) [s] for the tension sigma [N/m]; none if it is zero."""
    if sigma == 0:
        return {}
    half = 0.5 * grid.support_radius
    seconds = 0.25 * math.sqrt(liquid_of(others).rest_density * half**3 / (2 * math.pi * sigma))
    return {"capillary": StepLimit.constant(seconds)}
