"""Inputs and closed forms of He et al. 2014."""

import numpy as np

from refsim.core.cases import VARIATIONS, Exact, Variation, at, example, particles, plain_keeps, prepared
from refsim.smoothing.cases import for_each_kernel
from refsim.surface_tension.he_2014 import AirPressure, GradientEnergy, He2014

example(He2014(surface_tension=0.1, air_pressure=1.0), brings="color color_gradient_squared")

# from a corner of the liquid to slightly crowded
particles(color=lambda case, random: random.uniform(0.2, 1.1, case.count))


@particles("color_gradient_squared")
def _squares(case, random):
    """From none in the bulk to that of a sharp surface."""
    values = random.uniform(0, 1, case.count) / case.support_radius**2
    values[2::5] = 0
    return values


# both terms of like size
prepared("gradient_energy air_pressure", lambda case: He2014(kappa=3.0 * case.support_radius**2, air_pressure=2.0))

VARIATIONS[GradientEnergy] = Variation(lambda group, inputs, kernel: {"quarter": float(group.kappa) / 4})
plain_keeps(
    "he_2014.tension",
    air_pressure="the equation is the sum of gradient energy and air pressure; the pressure needs no color",
)

PAIR = at("energetic_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
GIVEN = {"mass": [2.0, 3.0], "density": [1000.0, 600.0]}
VOLUME = np.array([2 / 1000, 3 / 600])

# c_1 = V_1 W(0) + V_2 W(h/2)
for_each_kernel(
    "he_2014.color", two_colors=lambda w: Exact(PAIR, GIVEN, {"color": w.at_zero * (VOLUME + w.share * VOLUME[::-1])})
)


@for_each_kernel("he_2014.squared_gradient")
def two_squares(w):
    """|grad c_1|^2 = (V_2 c_2 W'/c_1)^2."""
    color = np.array([0.5, 0.25])
    value = (VOLUME[::-1] * color[::-1] * w.slope / color) ** 2
    return Exact(PAIR, GIVEN | {"color": color}, {"color_gradient_squared": value})


@for_each_kernel("he_2014.tension")
def drawn_together(w):
    """a_1 = (V_2/rho_1) (kappa/4 (g_1 + g_2) + p_atm) |W'| towards 2."""
    pull = VOLUME[0] * VOLUME[1] * (8 / 4 * (0.5 + 0.25) + 3.0) * w.slope
    inputs = GIVEN | {
        "color_gradient_squared": [0.5, 0.25], "gradient_energy": GradientEnergy(8.0, 2.0),
        "air_pressure": AirPressure(3.0),
    }  # fmt: skip
    return Exact(PAIR, inputs, {"acceleration": [[0.0, pull / 2, 0.0], [0.0, -pull / 3, 0.0]]})
