"""Cosine-shaped pair force after Tartakovsky & Meakin 2005 (Jiang & Zhu 2023, reference [7]; Dong 2016, [8]).

Jiang & Zhu write that the force has no repulsion, Dong that it vanishes as r does. Neither holds for
s cos(3 pi r/(2 h)) e_ij: it repels below h/3 and tends to s as r -> 0.
"""

import math
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.core.checked import NotNegative
from refsim.core.effect import Discretisation, Others
from refsim.sph import liquid_of
from refsim.surface_tension.cohesion import PairCohesion


class CosineForce(NamedTuple):
    """Parameters of the pair force in kernels."""

    strength: float  # s [N; N/m in 2D]
    wave_number: float  # 3 pi/(2 h) [1/m]


class TartakovskyMeakin2005(PairCohesion, frozen=True, kw_only=True):
    """Surface tension of a free liquid surface by a pair force that repels below h/3 and attracts beyond.

    strength          s [N; N/m in 2D], instead of sigma; the force of a pair does not depend on its masses

    The force conserves linear and angular momentum.
    """

    name: ClassVar[str] = "tartakovsky_meakin_2005"
    coefficient_name: ClassVar[str] = "strength"

    strength: NotNegative | None = None

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        strength = self.coefficient(grid, others)
        wave_number = 1.5 * math.pi / grid.support_radius
        return {"cosine_force": CosineForce(grid.real(strength), grid.real(wave_number))}

    def force_of(self, coefficient: float, r: NDArray, grid: Discretisation, others: Others) -> NDArray:
        """s cos(3 pi r/(2 h))/m^2 [N/kg^2] for particles of the lattice's mass."""
        mass = liquid_of(others).particle_mass(grid)
        q = r / grid.support_radius
        return np.where(q < 1, coefficient / mass**2 * np.cos(1.5 * np.pi * q), 0.0)
