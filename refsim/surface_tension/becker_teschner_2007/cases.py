"""Inputs and closed forms of Becker & Teschner 2007."""

import math

import numpy as np

from refsim.core.cases import VARIATIONS, Exact, Variation, closed_form, example, pair_case, prepared, takes
from refsim.surface_tension.becker_teschner_2007 import Attraction, BeckerTeschner2007

example(BeckerTeschner2007(surface_tension=0.5))


prepared("attraction", lambda case: BeckerTeschner2007(kappa=3.0, clamp_distance=case.literal))


def _attraction_follows(group, inputs, kernel):
    """kappa W(0) of the cubic spline: 40/(7 pi h^2) in the plane, 8/(pi h^3) in space."""
    at_zero = (8 if kernel.dim == 3 else 40 / 7) / (math.pi * float(kernel.support_radius) ** int(kernel.dim))
    return {"strength": float(group.kappa) * at_zero}


VARIATIONS[Attraction] = Variation(_attraction_follows, other={"least_q": lambda q: 0.6})
takes("becker_teschner_2007.cohesion", smoothing="support_radius dim")


def _pair(kernel, least_q):
    """h = 2 m in 3D: W(0) = 1/pi, W(h/2) = W(0)/4, W(h/4) = (1 - 6/16 + 6/64) W(0) = 23/32 W(0)."""
    pull = 0.5 * kernel / math.pi * 0.5
    given = {"mass": [2.0, 3.0], "attraction": Attraction(0.5, 0.5 / math.pi, least_q)}
    expected = np.array([[0.0, 3 / 2 * pull, 0.0], [0.0, -2 / 3 * pull, 0.0]])
    return Exact(pair_case("attracted_pair", 0.5), given, {"acceleration": expected})


closed_form(
    "becker_teschner_2007.cohesion",
    plain_pair=lambda: _pair(23 / 32, 0.0),  # a_1 = -kappa m_2/m_1 W(h/4) x_12
    clamped_pair=lambda: _pair(1 / 4, 0.5),  # below one spacing the kernel is W(h/2)
)
