"""Inputs and closed form of the tension by normal differences."""

import numpy as np

from refsim.core.cases import Exact, closed_form, example, other, pair_case, prepared, readings, takes
from refsim.surface_tension.normal_difference_2014 import NormalDifference, NormalDifference2014

example(NormalDifference2014(area_acceleration=0.5), brings="surface_normal")

prepared("normal_tension", lambda case: NormalDifference2014(area_acceleration=5.0))

as_printed = other("normal_tension", printed_mass=1)
readings(normal_tension="printed_mass")
takes("normal_difference_2014.tension", smoothing="support_radius")


@closed_form("normal_difference_2014.tension")
def pair_with_normals():
    """m = 2 and 3 kg: a_1 = -gamma (6/5) (n_1 - n_2), a_2 = gamma (4/5) (n_1 - n_2)."""
    pair = pair_case("difference_pair")
    difference = np.array([0.5, -1.0, 0.25])
    inputs = {
        "mass": [2.0, 3.0], "surface_normal": [difference, [0.0, 0.0, 0.0]], "normal_tension": NormalDifference(8.0, 0),
    }  # fmt: skip
    return Exact(pair, inputs, {"acceleration": 8.0 * np.array([-6 / 5 * difference, 4 / 5 * difference])})
