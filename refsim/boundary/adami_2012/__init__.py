"""Walls whose pressure is extrapolated from the liquid, after Adami, Hu & Adams 2012.

There is no effect of this name: `box_walls` and `mesh_boundary` add the passes with `model = "extrapolated"`.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

from refsim.boundary.adami_2012 import reference as reference
from refsim.core.capabilities import BringsWalls, having
from refsim.core.effect import Discretisation, Others, Pass
from refsim.core.fields import Field
from refsim.sph import acceleration_of, liquid_of

WALL_PRESSURE = Field("wall_pressure", "Pa", "pressure of the wall particles, from the liquid", rows="walls")
LEAST_SHARE = 1e-3  # of a cell that a wall particle fills


def passes(own: BringsWalls, others: Others) -> tuple[Pass, ...]:
    """Extrapolation and push of all walls, where `own` is the first effect with such walls; solids take no part."""
    if own is not next(effect for effect in having(others, BringsWalls) if effect.extrapolates()):
        return ()
    solids = ("phase",) if "two_way_coupling" in others else ()
    names: dict[str, str | None] = {} if solids else {"phase": None}
    reads = ("position", "density", "pressure", *solids)
    return (
        Pass("adami_2012.extrapolation", reads, ("wall_pressure",), names=names),
        liquid_of(others).with_own_force(
            "adami_2012.wall_force", (*reads, "wall_pressure"), {"smoothing": "gradient_smoothing", **names}, "pressure"
        ),
    )  # fmt: skip


def walls_model(others: Others) -> Literal["mirrored", "extrapolated"]:
    """Model of walls that name none: extrapolated where the liquid's density is advanced."""
    return "extrapolated" if liquid_of(others).settled(others).advances() else "mirrored"


def layers(grid: Discretisation) -> int:
    """As many layers of wall particles as the support is wide, and one more."""
    return math.ceil(grid.support_radius / grid.spacing * (1 - 1e-9)) + 1


class Lean(NamedTuple):
    """g - a_w as the kernels take it: the acceleration of gravity seen from the walls [m/s^2]."""

    x: Any  # [m/s^2]
    y: Any  # [m/s^2]
    z: Any  # [m/s^2]


def lean(grid: Discretisation, others: Others) -> dict[str, Lean]:
    """Parameter group of the extrapolation, for `Effect.prepare`: walls at rest."""
    return {"lean": Lean(*map(grid.real, acceleration_of(others)))}
