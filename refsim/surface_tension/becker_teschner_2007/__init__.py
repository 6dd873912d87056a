"""Attraction between particles after Becker & Teschner 2007 (Jiang & Zhu 2023, reference [8]; Dong 2016, [9]).

Contents: BeckerTeschner2007; operation becker_teschner_2007.cohesion.

Every pair attracts at every distance; only the pressure keeps particles apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

from numpy.typing import NDArray

from refsim.core.effect import Discretisation, Effect, Pass, require
from refsim.core.energy import EnergyAccount
from refsim.smoothing.shapes import CUBIC_SPLINE, NORMALISATION
from refsim.sph import liquid_of
from refsim.surface_tension.becker_teschner_2007.reference import attraction_function
from refsim.surface_tension.cohesion import PairCohesion, given_one, nominal_tension, one_of


class Attraction(NamedTuple):
    """Parameters of the attraction in kernels."""

    kappa: float  # [m^dim/s^2]
    strength: float  # kappa W(0) [1/s^2]
    least_q: float  # distance below which W is constant, as a share of h


class BeckerTeschner2007(PairCohesion, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by plain attraction.

    surface_tension   sigma [N/m]; nominal: turned into kappa by the Kirkwood-Buff integral
    kappa             coefficient of the attraction [m^3/s^2; m^2/s^2 in 2D], instead of sigma
    clamp_distance    W is constant below one spacing (not in the paper, where nearer pairs attract more)
    balance_pressure  the equation of state balances the cohesion of the bulk by P_int (rho/rho0)^2 (not in the paper);
                      without it cohesion compresses the liquid

    The forces of a pair are opposite and equal for equal masses only; linear and angular momentum are then conserved.
    """

    name: ClassVar[str] = "becker_teschner_2007"

    surface_tension: float | None = None
    kappa: float | None = None
    clamp_distance: bool = True

    def check(self, grid: Discretisation, others: Mapping[str, Effect]) -> None:
        one_of(self.name, surface_tension=self.surface_tension, kappa=self.kappa)
        own = {"surface_tension": self.surface_tension, "kappa": self.kappa}
        require(self.name, **{key: (value, "not negative") for key, value in own.items() if value is not None})
        self.check_collapse(grid, others)

    def coefficient(self, grid: Discretisation, others: Mapping[str, Effect]) -> float:
        """kappa [m^dim/s^2], given or from sigma."""
        if self.kappa is not None:
            return self.kappa
        rest_density = liquid_of(others).rest_density
        unit = nominal_tension(self._force_of(1.0, grid, others), rest_density, grid.support_radius, grid.dim)
        return given_one(self.surface_tension) / unit

    def pair_force(self, r: NDArray, grid: Discretisation, others: Mapping[str, Effect]) -> NDArray:
        """-kappa W(max(r, d)) r/m [N/kg^2] for particles of the lattice's mass."""
        return self._force_of(self.coefficient(grid, others), grid, others)(r)

    def notes(self, grid: Discretisation, others: Mapping[str, Effect]) -> tuple[str, ...]:
        notes = super().notes(grid, others)
        if self.clamp_distance or not self.passes(others):
            return notes
        return (
            *notes,
            f"{self.name}: without clamp_distance nearer pairs attract more: particles were found to pile up until"
            " drops burst",
        )

    def passes(self, others: Mapping[str, Effect]) -> tuple[Pass, ...]:
        if (self.kappa if self.kappa is not None else self.surface_tension) == 0:
            return ()
        return (Pass("becker_teschner_2007.cohesion", ("position", "mass"), updates=("acceleration",)),)

    def pair_mass(self, mass_i: NDArray, mass_j: NDArray, grid: Discretisation, others: Mapping[str, Effect]) -> Any:
        """m times the pair's mean mass, m of the lattice's particles: the force on i has the factor m_j alone."""
        return liquid_of(others).particle_mass(grid) * 0.5 * (mass_i + mass_j)

    def energy(self, grid: Discretisation, others: Mapping[str, Effect]) -> EnergyAccount:
        return self.pair_account(grid, others) if self.passes(others) else EnergyAccount()

    def list_radius(self, grid: Discretisation) -> float:
        return grid.support_radius if self.passes({}) else 0.0

    def prepare(self, grid: Discretisation, others: Mapping[str, Effect]) -> dict[str, Any]:
        kappa = self.coefficient(grid, others)
        at_zero = NORMALISATION[CUBIC_SPLINE][grid.dim] / grid.support_radius**grid.dim
        least = self._least_distance(grid) / grid.support_radius
        return {"attraction": Attraction(grid.real(kappa), grid.real(kappa * at_zero), grid.real(least))}

    def _least_distance(self, grid: Discretisation) -> float:
        return grid.spacing if self.clamp_distance else 0.0

    def _force_of(self, kappa: float, grid: Discretisation, others: Mapping[str, Effect]) -> Any:
        mass = liquid_of(others).particle_mass(grid)
        h, least = grid.support_radius, self._least_distance(grid)
        return lambda r: -kappa / mass * attraction_function(r, h, grid.dim, least) * r
