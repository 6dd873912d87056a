"""Walls whose pressure is extrapolated from the liquid, after Adami, Hu & Adams 2012.

Contents: WALL_PRESSURE, WallGravity; operations adami_2012.extrapolation, adami_2012.wall_force. There is no effect of
this name: `box_walls(model = "extrapolated")` adds the passes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from refsim.boundary.adami_2012 import reference as reference
from refsim.core.effect import Pass
from refsim.core.fields import Field

WALL_PRESSURE = Field("wall_pressure", "Pa", "pressure of the wall particles, from the liquid", rows="walls")
PASSES = (
    Pass("adami_2012.extrapolation", ("position", "density", "pressure"), ("wall_pressure",)),
    Pass(
        "adami_2012.wall_force", ("position", "density", "pressure", "wall_pressure"), updates=("acceleration",),
        names={"smoothing": "gradient_smoothing"},
    ),
)  # fmt: skip


class Lean(NamedTuple):
    """g - a_w as the kernels take it: the acceleration of gravity seen from the walls [m/s^2]."""

    x: Any
    y: Any
    z: Any
