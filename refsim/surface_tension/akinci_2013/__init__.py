"""Cohesion, area term and adhesion after Akinci, Akinci & Teschner 2013 (Jiang & Zhu 2023, reference [9]).

The paper gives cohesion and area term one coefficient gamma, although the dimensions of the two differ by a density:
for water in SI units the coefficient of the area term is 0.001 gamma rho0. Here each term has its own coefficient.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

from numpy.typing import NDArray

from refsim.core.capabilities import BringsWalls, HasErrata, Margin, effects_with
from refsim.core.checked import NotNegative, Printed
from refsim.core.effect import Discretisation, Field, Others, Pass
from refsim.core.errors import InputError
from refsim.sph import liquid_of
from refsim.surface_normal import SURFACE_NORMAL, axial_part, color_gradient_pass, normal_term
from refsim.surface_tension import cohesion
from refsim.surface_tension.akinci_2013 import operations as operations
from refsim.surface_tension.akinci_2013.reference import cohesion_function

# eps/(gamma rho0) of the one printed coefficient, for water in SI units, and of measured tension, in free drops, and in
# containers 2e-5/S within limits: with less of the area term the lattice under the pressure of cohesion resists strain,
# drops swing faster than their jump tells and small tanks crowd; with more, tanks of large S stand too high
WATER_RATIO, FREE_RATIO, CONTAINED_RATIO, CONTAINED = 1e-3, 4e-3, 2e-5, (3e-3, 8e-3)
# eps N/(gamma rho0), with N neighbours in the support, up to which drops come to rest, and from which on they fly
# apart at any step (docs/stability.md). The area term grows with N, since its sum contains no volume.
LARGEST_AREA, SHATTERING_AREA = 0.14, 1.0


class CohesionSpline(NamedTuple):
    """Parameters of the cohesion in kernels."""

    gamma: float  # [m^4/(kg s^2)]
    amplitude: float  # gamma 32/(pi h^dim)


class AreaMinimisation(NamedTuple):
    """Parameters of the area term in kernels."""

    coefficient: float  # eps [m/s^2]


class Adhesion(NamedTuple):
    """Parameters of the adhesion in kernels."""

    beta: float  # [m^4/(kg s^2)]
    amplitude: float  # beta 0.007/h^dim


class Akinci2013(cohesion.PairCohesion, HasErrata, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface, and adhesion to walls.

    surface_tension    sigma [N/m]: that of measured drops in the default liquid, in 2D of free ones; else nominal,
                       turned into gamma by the Kirkwood-Buff integral, to which the area term adds: up to several
                       times as much is measured
    gamma              coefficient of the cohesion [m^4/(kg s^2)], instead of sigma
    area_acceleration  eps [m/s^2], coefficient of the area term; left out, 0.001 gamma rho0, the value that one
                       coefficient for both terms has for water in SI units; of a calibrated tension 0.004 gamma rho0
                       in free drops, 0.003 to 0.008 in containers
    area_direction     of the area term between a pair: "normals" (n_i - n_j, the paper's) or "axial", its part along
                       e_ij with (dim + 2)/2 times eps, which conserves angular momentum; the tension is another one
    adhesion           beta [m^4/(kg s^2)], coefficient of the attraction by wall particles
    balance_pressure   the equation of state balances the cohesion of the bulk by P_int (rho/rho0)^2 (not in the
                       paper); without it cohesion compresses the liquid
    literal            readings of the paper: its own choice "gamma" (one coefficient for both terms: eps = gamma in SI
                       units at any rho0), also as "all"; "paper" balances nothing, too

    Cohesion conserves linear and angular momentum. The area term conserves linear momentum for equal masses, but not
    angular momentum, because n_i - n_j is not parallel to e_ij. The area term does not vanish at r = h: where a pair
    crosses r = h, the acceleration jumps by K_ij eps |n_i - n_j|, at most 3.2 s^2 eps with s = rho0 over the least
    density near by.
    """

    name: ClassVar[str] = "akinci_2013"
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "gamma", "area_acceleration", "adhesion")
    coefficient_name: ClassVar[str] = "gamma"
    # middle between jump and frequency of drops of 10 d, over the area term in printed ones
    measured: ClassVar[cohesion.Measured] = {3: (
        (2.6, ((0.0005, 3.197), (0.001, 3.149), (0.002, 3.074), (0.003, 2.954), (0.004, 2.799), (0.005, 2.579),
              (0.0067, 2.331), (0.01, 2.153), (0.015, 2.032), (0.02, 1.918), (0.025, 1.809), (0.03, 1.695))),
        (2.8, ((0.0015, 3.84), (0.003, 3.375), (0.005, 2.946), (0.0067, 2.822), (0.0125, 2.589))),
        (3.0, ((0.001, 4.887), (0.002, 4.509), (0.003, 4.091), (0.0067, 3.609), (0.0125, 3.313))),
    )}  # fmt: skip
    by_radius: ClassVar[Mapping[int, tuple[tuple[float, tuple[Any, ...]], ...]]] = {3: (
        (6.0, (
            (2.6, ((0.0005, 0.934), (0.001, 0.914), (0.002, 0.893), (0.003, 0.879), (0.004, 0.886),
                  (0.005, 0.913), (0.0067, 0.960), (0.01, 0.983), (0.015, 0.981), (0.02, 0.980), (0.025, 0.986),
                        (0.03, 0.970))),
            (2.8, ((0.0015, 0.831), (0.003, 0.859), (0.005, 0.930), (0.0067, 0.943), (0.0125, 0.940))),
            (3.0, ((0.001, 0.808), (0.002, 0.819), (0.003, 0.869), (0.0067, 0.905), (0.0125, 0.897))),
        )),
        (8.0, (
            (2.6, ((0.0005, 0.988), (0.001, 0.980), (0.002, 0.963), (0.003, 0.934), (0.004, 0.924),
                  (0.005, 0.956), (0.0067, 0.975), (0.01, 0.994), (0.015, 0.996), (0.02, 1.001), (0.025, 1.004),
                        (0.03, 1.014))),
            (2.8, ((0.0015, 0.931), (0.003, 0.927), (0.005, 0.977), (0.0067, 0.988), (0.0125, 0.990))),
            (3.0, ((0.001, 0.920), (0.002, 0.911), (0.003, 0.940), (0.0067, 0.978), (0.0125, 0.973))),
        )),
        (9.0, (
            (2.6, ((0.0005, 0.998), (0.001, 0.996), (0.002, 0.985), (0.003, 0.977), (0.004, 0.957),
                  (0.005, 0.973), (0.0067, 0.979), (0.01, 0.997), (0.015, 0.999), (0.02, 1.005), (0.025, 1.004),
                        (0.03, 1.011))),
            (2.8, ((0.0015, 0.976), (0.003, 0.961), (0.005, 0.980), (0.0067, 0.996), (0.0125, 0.998))),
            (3.0, ((0.001, 0.966), (0.002, 0.956), (0.003, 0.961), (0.0067, 0.994), (0.0125, 0.991))),
        )),
        (10.0, ((2.6, ((0.001, 1.0),)),)),
        (14.0, (
            (2.6, ((0.0005, 1.008), (0.001, 0.997), (0.002, 1.015), (0.003, 1.030), (0.004, 1.020),
                  (0.005, 1.023), (0.0067, 1.041), (0.01, 0.996), (0.015, 0.976), (0.02, 0.967), (0.025, 0.947),
                        (0.03, 0.953))),
            (2.8, ((0.0015, 1.024), (0.003, 1.046), (0.005, 1.018), (0.0067, 1.007), (0.0125, 0.996))),
            (3.0, ((0.001, 1.029), (0.002, 1.067), (0.003, 1.051), (0.0067, 1.010), (0.0125, 0.997))),
        )),
        (20.0, (
            (2.6, ((0.0005, 1.004), (0.001, 0.995), (0.002, 1.017), (0.003, 1.035), (0.004, 1.062),
                  (0.005, 1.019), (0.0067, 1.081), (0.01, 0.994), (0.02, 0.946), (0.03, 0.898))),
            (2.8, ((0.0015, 1.028), (0.003, 1.072), (0.005, 1.076), (0.0067, 1.030), (0.0125, 0.993))),
            (3.0, ((0.001, 1.032), (0.002, 1.094), (0.003, 1.058), (0.0067, 1.022), (0.0125, 0.997))),
        )),
    )}  # fmt: skip
    on_walls: ClassVar[str] = "80 to 90 (in 2D 100 to 120)"
    radii: ClassVar[Mapping[int, tuple[float, float, str]]] = {
        3: (10.0, 12.0, "it is off by up to 0.06 (6 to 9 and 14 spacings) and 0.14 (20)")
    }
    held: ClassVar[float] = 2.6  # with 2.3 they differ by 0.1
    free: ClassVar[cohesion.FreeDrops] = cohesion.FreeDrops(
        measured={
            2: (
                (2.6, ((0.001, 3.02), (0.004, 2.94), (0.01, 2.9))),
                (3.0, ((0.002, 3.95), (0.006, 3.81), (0.012, 3.75))),
            ),
            3: (
                (2.6, ((0.0006, 12.6), (0.001, 12.46), (0.002, 12.22), (0.004, 12.17), (0.01, 11.88), (0.025, 11.08))),
                (2.8, ((0.003, 15.27), (0.006, 15.14))),
                (3.0, ((0.002, 19.24), (0.003, 19.24), (0.006, 19.06), (0.008, 19.02), (0.012, 18.6))),
            ),
        },
        by_radius={
            2: (
                (6.0, (
                    (2.6, ((0.001, 0.964), (0.004, 0.959), (0.01, 0.959))),
                    (3.0, ((0.002, 0.868), (0.006, 0.916), (0.012, 0.939))),
                )),
                (8.0, (
                    (2.6, ((0.001, 0.990), (0.004, 0.990), (0.01, 0.993))),
                    (3.0, ((0.002, 0.962), (0.006, 0.987), (0.012, 0.992))),
                )),
                (10.0, ((2.6, ((0.001, 1.0),)),)),
                (20.0, (
                    (2.6, ((0.001, 0.990), (0.004, 0.993), (0.01, 1.003))),
                    (3.0, ((0.002, 0.987), (0.006, 0.984), (0.012, 0.981))),
                )),
            ),
            3: (
                (6.0, (
                    (2.6, ((0.0006, 0.931), (0.001, 0.917), (0.002, 0.902),
                            (0.004, 0.928), (0.01, 0.953), (0.025, 0.981))),
                    (2.8, ((0.003, 0.878), (0.006, 0.912))),
                    (3.0, ((0.002, 0.836), (0.003, 0.861), (0.006, 0.901), (0.008, 0.907), (0.012, 0.941))),
                )),
                (8.0, (
                    (2.6, ((0.0006, 0.989), (0.001, 0.978), (0.002, 0.979),
                            (0.004, 0.983), (0.01, 0.987), (0.025, 1.002))),
                    (2.8, ((0.003, 0.966), (0.006, 0.981))),
                    (3.0, ((0.002, 0.941), (0.003, 0.966), (0.006, 0.981), (0.008, 0.987), (0.012, 0.994))),
                )),
                (10.0, ((2.6, ((0.001, 1.0),)),)),
                (20.0, (
                    (2.6, ((0.0006, 0.996), (0.001, 1.001), (0.002, 1.008),
                            (0.004, 1.000), (0.01, 0.993), (0.025, 1.012))),
                    (2.8, ((0.003, 1.002), (0.006, 0.990))),
                    (3.0, ((0.002, 1.015), (0.003, 1.005), (0.006, 0.993), (0.008, 0.971), (0.012, 0.965))),
                )),
            ),
        },
        radii={
            2: (6.0, 20.0, "none was measured"),
            3: (10.0, 20.0, "it is off by up to 0.06 (6 and 8.5 spacings)"),
        },
        held=2.6,
    )  # fmt: skip
    beyond: ClassVar[str] = ", about 1.2 times as much at 3.2 spacings"
    shown: ClassVar[Mapping[int, tuple[str, str]]] = {2: ("0.6 to 0.9", "0.8 to 2.2")}
    source: ClassVar[str] = "Akinci et al."
    errata: ClassVar[tuple[str, ...]] = ("gamma",)
    improvements: ClassVar[tuple[str, ...]] = errata
    paper: ClassVar[Mapping[str, Any]] = {"balance_pressure": False}

    surface_tension: NotNegative | None = None
    gamma: NotNegative | None = None
    area_acceleration: NotNegative | None = None
    area_direction: Literal["normals", "axial"] = "normals"
    adhesion: NotNegative = 0.0
    literal: Printed = ()

    def check(self, grid: Discretisation, others: Others) -> None:
        self.check_coefficients()
        if "gamma" in self.printed() and self.area_acceleration is not None:
            raise InputError(
                f"{self.name}: literal 'gamma' sets the coefficient of the area term, and so does area_acceleration;"
                " give one of them."
            )
        self.check_collapse(grid, others)

    def area_coefficient(self, grid: Discretisation, others: Others) -> float:
        """eps [m/s^2], given or from gamma."""
        gamma = self.coefficient(grid, others)
        if "gamma" in self.printed():
            return gamma
        if self.area_acceleration is not None:
            return self.area_acceleration
        return self._area_ratio(grid, others) * gamma * liquid_of(others).rest_density

    def share_of_nominal(self, grid: Discretisation, others: Others) -> float:
        """In containers nearly in proportion to the area term, of which `measured` has the printed one's."""
        share, free = super().share_of_nominal(grid, others), self._drops(grid, others) is self.free
        return share if free else share * self._area_ratio(grid, others) / WATER_RATIO

    def _area_ratio(self, grid: Discretisation, others: Others) -> float:
        """eps/(gamma rho0), where it is not given."""
        if (stiffness := self._measured_at(grid, others)) is None:
            return WATER_RATIO
        if self._drops(grid, others) is self.free:
            return FREE_RATIO
        return min(max(CONTAINED_RATIO / stiffness, CONTAINED[0]), CONTAINED[1])

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """-gamma C(r) [N/kg^2]; K_ij is 1 in the undisturbed bulk."""
        return -coefficient * cohesion_function(r, grid.support_radius, grid.dim).value

    def fields(self, others: Others) -> tuple[Field, ...]:
        return (SURFACE_NORMAL,) if self._has_area() else ()

    def passes(self, others: Others) -> tuple[Pass, ...]:
        passes: list[Pass] = []
        if self._has_area():
            passes.append(color_gradient_pass())
        if self.coheres() or self._has_area():
            names = {"area_normal": "surface_normal" if self._has_area() else None}
            passes.append(Pass("akinci_2013.tension", updates=("acceleration",), names=names))
        if self.adhesion > 0 and effects_with(others, BringsWalls):
            passes.append(Pass("akinci_2013.adhesion", updates=("acceleration",)))
        return tuple(passes)

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        real, volume = grid.real, grid.support_radius**grid.dim
        fluid = liquid_of(others)
        gamma, beta = self.coefficient(grid, others), self.adhesion
        groups = normal_term(fluid, grid) | axial_part(self.area_direction, grid)
        return groups | {
            "spline": CohesionSpline(real(gamma), real(gamma * 32 / (math.pi * volume))) if self.coheres() else None,
            "area_term": AreaMinimisation(real(self.area_coefficient(grid, others))) if self._has_area() else None,
            "adhesion": Adhesion(real(beta), real(0.007 * beta / volume)),
        }

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        return (*super().notes(grid, others), *self._unstable(grid, others))

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        yield from super().margins(grid, others)
        if self._has_area() and self.coheres() and self._measured_at(grid, others) is None:
            unit = self.coefficient(grid, others) * liquid_of(others).rest_density
            near, value = cohesion.neighbours_in_support(grid), self.area_coefficient(grid, others) / unit
            largest, fate = LARGEST_AREA / near, "fly apart" if value * near >= SHATTERING_AREA else "boil"
            name = "area_acceleration/(gamma rho0)"
            consequence = (
                f"{name} = {value:.3g} is above {largest:.2g}, up to which drops with {near:.0f} neighbours come to"
                f" rest: they {fate}; a shorter step does not help"
            )
            yield Margin(name, value, largest, beyond=consequence)

    def _unstable(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Notes on an area term that changes angular momentum, stands alone, or adds kinetic energy."""
        if not self._has_area():
            return
        if note := cohesion.angular_momentum_note(self.name, "area term", others, self.area_direction):
            yield note
        if not self.coheres():
            yield cohesion.spreading_note(self.name, "area term")
        elif "iisph" in others:
            yield (
                f"{self.name}: with implicit pressure the area term adds kinetic energy: drops of some hundred"
                " particles were found to tremble at rest, with up to 40 % of their initial kinetic energy at any step;"
                " with area_acceleration = 0 they come to rest"
            )

    def _has_area(self) -> bool:
        """Whether the area term is computed: not if its coefficient is zero."""
        return self.area_acceleration != 0 and (self.coheres() or self.area_acceleration is not None)
