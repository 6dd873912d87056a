"""Inputs and closed forms of Tartakovsky & Meakin 2005."""

import math

from refsim.core.cases import VARIATIONS, Exact, Variation, closed_form, example, following, pair_case, prepared, takes
from refsim.surface_tension.tartakovsky_meakin_2005 import CosineForce, TartakovskyMeakin2005

example(TartakovskyMeakin2005(surface_tension=0.5))

prepared("cosine_force", lambda case: TartakovskyMeakin2005(strength=3.0))

VARIATIONS[CosineForce] = Variation(following(wave_number=lambda group, h, dim: 1.5 * math.pi / h))
takes("tartakovsky_meakin_2005.cohesion", smoothing="support_radius")


def _pair(r, force):
    """h = 2 m; the force on the second particle."""
    inputs = {"mass": [2.0, 3.0], "cosine_force": CosineForce(12.0, 0.75 * math.pi)}
    return Exact(pair_case("cosine_pair", r), inputs, {"acceleration": [[0, -force / 2, 0], [0, force / 3, 0]]})


closed_form(
    "tartakovsky_meakin_2005.cohesion",
    attracted_pair=lambda: _pair(1.0, -12 / math.sqrt(2)),  # at r = h/2 the force is s cos(3 pi/4) = -s/sqrt 2
    repelled_pair=lambda: _pair(1 / 3, 12 / math.sqrt(2)),  # at r = h/6 it is s cos(pi/4) = s/sqrt 2
)
