"""Attraction between particles after Becker & Teschner 2007 (Jiang & Zhu 2023, reference [8]; Dong 2016, [9]).

Every pair attracts at every distance; only the pressure keeps particles apart.
"""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

from numpy.typing import NDArray

from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Others
from refsim.smoothing.shapes import CUBIC_SPLINE, NORMALISATION
from refsim.sph import liquid_of
from refsim.surface_tension.becker_teschner_2007.reference import attraction_function
from refsim.surface_tension.cohesion import PairCohesion


class Attraction(NamedTuple):
    """Parameters of the attraction in kernels."""

    kappa: float  # [m^dim/s^2]
    strength: float  # kappa W(0) [1/s^2]
    least_q: float  # distance below which W is constant, as a share of h


class BeckerTeschner2007(PairCohesion, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by plain attraction.

    kappa             coefficient of the attraction [m^3/s^2; m^2/s^2 in 2D], instead of sigma
    clamp_distance    W is constant below one spacing (not in the paper, where nearer pairs attract more)

    Linear and angular momentum are conserved: m_j/m_i of the paper, for equal masses, is 2 m_j/(m_i + m_j) here.
    """

    name: ClassVar[str] = "becker_teschner_2007"
    coefficient_name: ClassVar[str] = "kappa"

    kappa: NotNegative | None = None
    clamp_distance: bool = True

    def own_notes(self, grid: Discretisation, others: Others) -> Iterator[str]:
        if not self.clamp_distance:
            yield (
                f"{self.name}: without clamp_distance nearer pairs attract more: particles were found to pile up until"
                " drops burst"
            )

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        kappa = self.coefficient(grid, others)
        at_zero = NORMALISATION[CUBIC_SPLINE][grid.dim] / grid.support_radius**grid.dim
        least = self._least_distance(grid) / grid.support_radius
        return {"attraction": Attraction(grid.real(kappa), grid.real(kappa * at_zero), grid.real(least))}

    def _least_distance(self, grid: Discretisation) -> float:
        return grid.spacing if self.clamp_distance else 0.0

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """-kappa W(max(r, d)) r/m [N/kg^2] for particles of the lattice's mass."""
        h, least = grid.support_radius, self._least_distance(grid)
        mass = liquid_of(others).particle_mass(grid)
        return -coefficient / mass * attraction_function(r, h, grid.dim, least) * r
