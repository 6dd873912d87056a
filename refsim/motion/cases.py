"""Inputs and a closed form of a frame that turns."""

import numpy as np

from refsim.core.cases import Exact, at, closed_form, groups


@groups("turning")
def _turning(case, grid):
    """About an oblique axis near the particles; about z in the plane."""
    w, rate = ((0.7, -1.1, 2.0), (-3.0, 0.5, 1.5)) if case.dim == 3 else ((0.0, 0.0, 2.0), (0.0, 0.0, 1.5))
    axis = case.spacing * np.array([0.4, -0.3, 0.2 if case.dim == 3 else 0.0])
    return {"turning": np.concatenate([w, rate, axis]).astype(grid.dtype)}


@closed_form("motion.turning")
def about_a_vertical_axis():
    """At (2, 0, 0) from an axis along z with w = 3: centrifugal 18 outwards, Euler -2 dw/dt, Coriolis 6 (v_y, -v_x)."""
    case = at("turning", [[3.0, 0.0, 0.0], [1.0, 0.0, 5.0]])
    inputs = {
        "velocity": [[0.5, -1.0, 4.0], [0.0, 0.0, 1.0]],
        "turning": [0.0, 0.0, 3.0, 0.0, 0.0, 0.25, 1.0, 0.0, 7.0],
    }
    return Exact(case, inputs, {"acceleration": [[18.0 - 6.0, -0.5 - 3.0, 0.0], [0.0, 0.0, 0.0]]})
