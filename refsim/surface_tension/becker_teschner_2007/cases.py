"""Inputs and closed forms of Becker & Teschner 2007."""

import math

import numpy as np

from refsim.core.cases import VARIATIONS, Exact, Variation, closed_form, example, following, pair_case, prepared, takes
from refsim.surface_tension.becker_teschner_2007 import Attraction, BeckerTeschner2007

example(BeckerTeschner2007(surface_tension=0.5))

prepared("attraction", lambda case: BeckerTeschner2007(kappa=3.0, clamp_distance=case.literal))

# kappa W(0) of the cubic spline
VARIATIONS[Attraction] = Variation(
    following(strength=lambda group, h, dim: float(group.kappa) * (8 if dim == 3 else 40 / 7) / (math.pi * h**dim)),
    other={"least_q": lambda q: 0.6},
)
takes("becker_teschner_2007.cohesion", smoothing="support_radius dim")


def _pair(kernel, least_q):
    """h = 2 m in 3D: W(0) = 1/pi, W(h/2) = W(0)/4, W(h/4) = (1 - 6/16 + 6/64) W(0) = 23/32 W(0)."""
    pull = 0.5 * kernel / math.pi * 0.5
    inputs = {"mass": [2.0, 3.0], "attraction": Attraction(0.5, 0.5 / math.pi, least_q)}
    expected = np.array([[0.0, 6 / 5 * pull, 0.0], [0.0, -4 / 5 * pull, 0.0]])
    return Exact(pair_case("attracted_pair", 0.5), inputs, {"acceleration": expected})


closed_form(
    "becker_teschner_2007.cohesion",
    plain_pair=lambda: _pair(23 / 32, 0.0),  # a_1 = -kappa 2 m_2/(m_1 + m_2) W(h/4) x_12
    clamped_pair=lambda: _pair(1 / 4, 0.5),  # below one spacing the kernel is W(h/2)
)
