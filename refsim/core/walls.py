"""Wall particles as every pass sees them, whichever effect made them.

Parameter groups are flat: Numba's parallel loops take tuples of arrays, not tuples of tuples.
"""

from typing import Any, NamedTuple

import numpy as np


class WallParticles(NamedTuple):
    """Wall particles on the host, as an effect hands them to the runner (float64)."""

    position: np.ndarray  # (m, 3) [m]
    volume: np.ndarray  # (m,) V_b [m^dim]


class Bounds(NamedTuple):
    """Planes that no particle passes, as the density of spray is too small to repel it; open sides are infinite.

    They stop what is between `first` and `last` before a step: where these are finite, the planes across them end.
    """

    lower: Any  # (3,) [m]
    upper: Any  # (3,) [m]
    first: Any  # (3,) [m]
    last: Any  # (3,) [m]


def planes(lower: Any, upper: Any, first: Any = -np.inf, last: Any = np.inf, dtype: Any = float) -> Bounds:
    """Planes, which have no end where none is given, in `dtype`."""
    return Bounds(*(np.broadcast_to(part, 3).astype(dtype) for part in (lower, upper, first, last)))


class WallViscosity(NamedTuple):
    """Friction at wall particles as the kernels take it."""

    coefficient: float  # mu_b [Pa s]


class Holding(NamedTuple):
    """Friction at wall particles that holds the liquid, as the kernels take it."""

    coefficient: float  # [Pa s]
    steepness: int  # n of the factor (1 - r/h)^n


class WallMotion(NamedTuple):
    """Planes beyond which wall particles move, infinite for none, and their velocity."""

    lower: Any  # (3,) [m]
    upper: Any  # (3,) [m]
    velocity: Any  # (3,) [m/s]


class WallRows(NamedTuple):
    """Wall particles and, row by row, those near each fluid particle (CPU)."""

    position: Any  # (m, 3) positions of the wall particles [m]
    volume: Any  # (m,) volumes of the wall particles [m^dim]
    start: Any
    count: Any
    entries: Any


class WallColumns(NamedTuple):
    """Wall particles and, column by column, those near each fluid particle (GPU)."""

    position: Any  # (m, 3) positions of the wall particles [m]
    volume: Any  # (m,) volumes of the wall particles [m^dim]
    count: Any
    entries: Any


class LiquidRows(NamedTuple):
    """Positions of the liquid particles and, row by row, those near each wall particle (CPU)."""

    position: Any  # (n, 3) positions of the liquid particles [m]
    start: Any
    count: Any
    entries: Any


class LiquidColumns(NamedTuple):
    """Positions of the liquid particles and, column by column, those near each wall particle (GPU)."""

    position: Any  # (n, 3) positions of the liquid particles [m]
    count: Any
    entries: Any


def liquid_with_list(position: Any, neighbours: Any) -> LiquidRows | LiquidColumns:
    """The liquid's positions together with a list of wall particles, whichever of the two forms it has."""
    if hasattr(neighbours, "start"):
        return LiquidRows(position, *neighbours)
    return LiquidColumns(position, neighbours.count, neighbours.entries)


def with_list(position: Any, volume: Any, neighbours: Any) -> WallRows | WallColumns:
    """Wall particles together with their list, whichever of the two forms it has."""
    if hasattr(neighbours, "start"):
        return WallRows(position, volume, *neighbours)
    return WallColumns(position, volume, neighbours.count, neighbours.entries)
