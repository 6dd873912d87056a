"""Cohesion, area term and adhesion after Akinci, Akinci & Teschner 2013 (Jiang & Zhu 2023, reference [9]).

The paper gives cohesion and area term one coefficient gamma, although the dimensions of the two differ by a density:
for water in SI units the coefficient of the area term is 0.001 gamma rho0. Here each term has its own coefficient.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Literal, NamedTuple

from numpy.typing import NDArray

from refsim.core.capabilities import BringsWalls, HasErrata, Margin, effects_with
from refsim.core.checked import NotNegative, Printed
from refsim.core.effect import Discretisation, Others, Pass
from refsim.core.errors import InputError
from refsim.sph import liquid_of
from refsim.surface_normal import axial_part, color_gradient_pass, normal_term
from refsim.surface_tension import cohesion
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
    literal            readings of the paper: its own choice "gamma" (one coefficient for both terms: eps = gamma in SI
                       units at any rho0), also as "all"; "paper" balances nothing, too

    Cohesion conserves linear and angular momentum. The area term conserves linear momentum for equal masses, but not
    angular momentum, because n_i - n_j is not parallel to e_ij. The area term does not vanish at r = h: where a pair
    crosses r = h, the acceleration jumps by K_ij eps |n_i - n_j|, at most 3.2 s^2 eps with s = rho0 over the least
    density near by.
    """

    name: ClassVar[str] = "akinci_2013"
    ends_abruptly: ClassVar[bool] = True
    scales: ClassVar[tuple[str, ...]] = ("surface_tension", "gamma", "area_acceleration", "adhesion")
    coefficient_name: ClassVar[str] = "gamma"
    source: ClassVar[str] = "Akinci et al."
    errata: ClassVar[tuple[str, ...]] = ("gamma",)
    improvements: ClassVar[tuple[str, ...]] = errata
    paper: ClassVar[Mapping[str, Any]] = {"balance_pressure": False}

    gamma: NotNegative | None = None
    area_acceleration: NotNegative | None = None
    area_direction: Literal["normals", "axial"] = "normals"
    adhesion: NotNegative = 0.0
    literal: Printed = ()

    def check_others(self, grid: Discretisation, others: Others) -> None:
        if "gamma" in self.printed() and self.area_acceleration is not None:
            raise InputError(
                f"{self.name}: literal 'gamma' sets the coefficient of the area term, and so does area_acceleration;"
                " give one of them."
            )

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
        share, free = super().share_of_nominal(grid, others), self._drops(grid, others).free
        return share if free else share * self._area_ratio(grid, others) / WATER_RATIO

    def _area_ratio(self, grid: Discretisation, others: Others) -> float:
        """eps/(gamma rho0), where it is not given."""
        if (stiffness := self._measured_at(grid, others)) is None:
            return WATER_RATIO
        if self._drops(grid, others).free:
            return FREE_RATIO
        return min(max(CONTAINED_RATIO / stiffness, CONTAINED[0]), CONTAINED[1])

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """-gamma C(r) [N/kg^2]; K_ij is 1 in the undisturbed bulk."""
        return -coefficient * cohesion_function(r, grid.support_radius, grid.dim).value

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

    def margins(self, grid: Discretisation, others: Others) -> Iterator[Margin]:
        yield from super().margins(grid, others)
        if self._has_area() and self.coheres() and self._measured_at(grid, others) is None:
            unit = self.coefficient(grid, others) * liquid_of(others).rest_density
            value, share = self.area_coefficient(grid, others) / unit, grid.support_radius / grid.spacing
            near = 4 * math.pi / 3 * share**3 if grid.dim == 3 else math.pi * share**2  # neighbours in the support
            largest, fate = LARGEST_AREA / near, "fly apart" if value * near >= SHATTERING_AREA else "boil"
            name = "area_acceleration/(gamma rho0)"
            consequence = (
                f"{name} = {value:.3g} is above {largest:.2g}, up to which drops with {near:.0f} neighbours come to"
                f" rest: they {fate}; a shorter step does not help"
            )
            yield Margin(name, value, largest, beyond=consequence)

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        """Notes on an area term that changes angular momentum, stands alone, or adds kinetic energy."""
        if not self._has_area():
            return
        yield from cohesion.angular_momentum_note(self.name, "area term", others, self.area_direction)
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
