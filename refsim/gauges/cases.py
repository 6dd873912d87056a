"""Inputs and closed forms of sums over the liquid at points."""

import math

import numpy as np

from refsim.core.cases import Case, Exact, closed_form, groups
from refsim.core.walls import WallParticles

W0 = 21 / (16 * math.pi)  # W(0) of Wendland C2, h = 2 m; W(h/2) = 3/16 W(0)


@groups("fill", "flow")
def _taken(case, grid):
    """What stands in the outputs before."""
    count = len(case.wall_position)
    return {"fill": np.full(count, 7.0, grid.dtype), "flow": np.full((count, 3), 7.0, grid.dtype)}


@closed_form("gauges.sample")
def between_two():
    """A point 1 m from two particles of 2 m^3 and 1 m^3; nothing far away."""
    place = np.array([[0.0, 1.0, 0.0], [0.0, 9.0, 0.0]])
    position = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    w = 3 / 16 * W0
    return Exact(
        Case("between_two_points", 3, position, spacing=1.0, support_radius=2.0, wall_position=place),
        {
            "velocity": np.array([[1.0, 0.0, -4.0], [0.0, 3.0, 2.0]]), "mass": np.array([2000.0, 500.0]),
            "density": np.array([1000.0, 500.0]), "walls": WallParticles(place, np.full(2, 0.5)), "period": None,
        },
        {"fill": np.array([3 * w, 0.0]), "flow": np.array([[2 * w, 3 * w, -6 * w], [0.0, 0.0, 0.0]])},
    )  # fmt: skip
