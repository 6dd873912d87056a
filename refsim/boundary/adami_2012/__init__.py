"""Walls whose pressure is extrapolated from the liquid, after Adami, Hu & Adams 2012.

There is no effect of this name: `box_walls` and `mesh_boundary` add the passes with `model = "extrapolated"`.
"""

from __future__ import annotations

import math
from typing import Literal

from refsim.boundary.adami_2012 import reference as reference
from refsim.core.capabilities import BringsWalls, having
from refsim.core.effect import Discretisation, Others, Pass
from refsim.core.energy import EnergyAccount
from refsim.core.fields import Field
from refsim.sph import liquid_of

WALL_PRESSURE = Field("wall_pressure", "Pa", "pressure of the wall particles, from the liquid", rows="walls")
WALL_STRAIN = Field("wall_strain", "m^(2 dim)/s", "strain of the liquid at the wall particles", rows="walls")
LEAST_SHARE = 1e-3  # of a cell that a wall particle fills


def passes(own: BringsWalls, others: Others) -> tuple[Pass, ...]:
    """Extrapolation and push of all walls, where `own` is the first effect with such walls; solids take no part."""
    if own is not next(effect for effect in having(others, BringsWalls) if effect.extrapolates()):
        return ()
    solids = ("phase",) if "two_way_coupling" in others else ()
    names: dict[str, str | None] = {"smoothing": "gradient_smoothing", **({} if solids else {"phase": None})}
    reads, liquid = ("position", "density", "pressure", *solids), liquid_of(others)
    moving = ("position", "velocity", "mass", "advanced_excess", *solids)
    return (
        *((Pass("adami_2012.strain", moving, ("wall_strain",), names=names),) if liquid.advances() else ()),
        Pass("adami_2012.extrapolation", reads, ("wall_pressure",), names=names),
        liquid.with_own_force("adami_2012.wall_force", (*reads, "wall_pressure"), names, "pressure"),
    )


def fields(others: Others) -> tuple[Field, ...]:
    """Fields of walls with an extrapolated pressure."""
    return (WALL_PRESSURE, WALL_STRAIN) if liquid_of(others).advances() else (WALL_PRESSURE,)


def account(others: Others) -> EnergyAccount | None:
    """Walls at rest do no work inside of an advanced density, which takes their strain; None beside a summed one."""
    liquid = liquid_of(others)
    return EnergyAccount(uncounted=("the walls' pressure at the surface",)) if liquid.advances() else None


def walls_model(others: Others) -> Literal["mirrored", "extrapolated"]:
    """Model of walls that name none: extrapolated where the liquid's density is advanced."""
    return "extrapolated" if liquid_of(others).settled(others).advances() else "mirrored"


def layers(grid: Discretisation) -> int:
    """As many layers of wall particles as the support is wide, and one more."""
    return math.ceil(grid.support_radius / grid.spacing * (1 - 1e-9)) + 1
