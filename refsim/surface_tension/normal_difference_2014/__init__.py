"""Surface tension from the difference of normals after patent CN104318598A (2014), patent P7.

The patent has no cohesion and states neither the normal nor a value of the coefficient. Here the normal is the colour
gradient of Akinci et al. 2013, J(19) (patent E29), and gamma is an acceleration.
"""

import functools
import itertools
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np

from refsim.core.capabilities import HasErrata, PullsParticles
from refsim.core.checked import NotNegative, Printed
from refsim.core.effect import Discretisation, Effect, Others, Pass, StepLimit, int32
from refsim.smoothing import lattice_neighbours, smoothing
from refsim.sph import LIQUID, SETS, liquid_of
from refsim.surface_normal import color_gradient_pass, normal_term
from refsim.surface_tension.cohesion import spreading_note

SAFETY = 0.5  # share of the step 2/omega beyond which the stiffest wave on the lattice grows


class NormalDifference(NamedTuple):
    """Parameters of the tension in kernels."""

    coefficient: float  # gamma [m/s^2]
    printed_mass: int  # 1: factor m_i as printed (patent P7); 0: harmonic mean of the masses


class NormalDifference2014(Effect, HasErrata, PullsParticles, frozen=True, kw_only=True):
    """Surface tension without cohesion: the force on a particle is opposite to its normal less its neighbours'.

    area_acceleration  gamma [m/s^2], coefficient of the force, which does not vanish at r = h: where a pair
                       crosses r = h, the acceleration jumps by gamma |n_i - n_j| (equal masses)
    literal            readings of the patent: its own choice "P7" (m_i, not the harmonic mean of the pair's masses:
                       momentum is conserved for equal masses only); or "paper" or "all", which are the same
    """

    name: ClassVar[str] = "normal_difference_2014"
    ends_abruptly: ClassVar[bool] = True
    scales: ClassVar[tuple[str, ...]] = ("area_acceleration",)
    source: ClassVar[str] = "patent"
    errata: ClassVar[tuple[str, ...]] = ("P7",)
    improvements: ClassVar[tuple[str, ...]] = errata
    virial: ClassVar[str] = "normals vanish in the bulk, and the stiffest wave limits the step"
    sums: ClassVar[bool] = True
    needed: ClassVar[tuple[str, ...]] = (LIQUID,)

    area_acceleration: NotNegative
    literal: Printed = ()

    def notes(self, grid: Discretisation, others: Others) -> tuple[str, ...]:
        return (spreading_note(self.name, "term"),)

    def passes(self, others: Others) -> tuple[Pass, ...]:
        return (color_gradient_pass(), Pass("normal_difference_2014.tension", updates=("acceleration",)))

    def prepare(self, grid: Discretisation, others: Others) -> dict[str, Any]:
        term = NormalDifference(grid.real(self.area_acceleration), int32("P7" in self.printed()))
        fluid = liquid_of(others)
        return {**normal_term(fluid, grid), "normal_tension": term}

    def step_limits(self, grid: Discretisation, others: Others) -> dict[str, StepLimit]:
        """SAFETY 2/omega of the stiffest wave on the lattice."""
        shape = SETS[liquid_of(others).kernels][1]
        stiffness = stiffest_wave(shape, grid.support_radius / grid.spacing, grid.dim)
        seconds = SAFETY * 2 / math.sqrt(stiffness * self.area_acceleration / grid.spacing)
        return {"normal_tension": StepLimit.constant(seconds)}


@functools.lru_cache(maxsize=64)
def stiffest_wave(shape: str, ratio: float, dim: int) -> float:
    """Largest omega^2 d/gamma of a wave of small displacements on the lattice under patent P7 alone; dimensionless.

    shape  kernel of the normals; ratio  h/d

    With x_j = x_j0 + A exp(i k.x_j0): omega^2 = (gamma h/d) N (D - S S^T), N = sum_j (1 - cos k.r),
    D = sum_j V grad grad W (1 - cos k.r), S = sum_j V grad W sin k.r.
    """
    from refsim.smoothing.reference import kernel_slope

    kernel = smoothing(shape, ratio, dim)
    r, length = lattice_neighbours(ratio, 1.0, dim)
    unit, slope, step = r / length[:, None], kernel_slope(length, kernel), 1e-4
    bend = (kernel_slope(np.minimum(length + step, ratio), kernel) - kernel_slope(length - step, kernel)) / (2 * step)
    along = unit[:, :, None] * unit[:, None, :]
    second = (bend - slope / length)[:, None, None] * along + (slope / length)[:, None, None] * np.eye(dim)
    largest = 0.0
    for k in itertools.product(np.linspace(0, math.pi, 9), repeat=dim):
        phase = r @ np.array(k)
        lag = 1 - np.cos(phase)
        d = np.einsum("j,jab->ab", lag, second)
        s = (np.sin(phase)[:, None] * slope[:, None] * unit).sum(0)
        largest = max(largest, float(np.linalg.eigvalsh(ratio * lag.sum() * (d - np.outer(s, s)))[-1]))
    return largest
