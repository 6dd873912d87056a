"""Inputs and closed forms of sums over the liquid at points."""

import numpy as np

from refsim.core.cases import Exact, at, groups
from refsim.core.walls import WallParticles
from refsim.smoothing.cases import for_each_kernel


@groups("fill", "flow")
def _taken(case, grid):
    """What stands in the outputs before."""
    count = len(case.wall_position)
    return {"fill": np.full(count, 7.0, grid.dtype), "flow": np.full((count, 3), 7.0, grid.dtype)}


@for_each_kernel("gauges.sample")
def between_two(w):
    """A point 1 m from two particles of 2 m^3 and 1 m^3; nothing far away."""
    place = np.array([[0.0, 1.0, 0.0], [0.0, 9.0, 0.0]])
    position = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    w = w.share * w.at_zero
    return Exact(
        at("between_two_points", position, place),
        {
            "velocity": [[1.0, 0.0, -4.0], [0.0, 3.0, 2.0]], "mass": [2000.0, 500.0], "density": [1000.0, 500.0],
            "walls": WallParticles(place, np.full(2, 0.5)), "period": None,
        }, {"fill": [3 * w, 0.0], "flow": [[2 * w, 3 * w, -6 * w], [0.0, 0.0, 0.0]]},
    )  # fmt: skip
