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


class ListedRows(NamedTuple):
    """Wall particles and, row by row, those near each fluid particle, or the liquid's near each wall particle (CPU)."""

    position: Any  # (m, 3) of the particles that are listed [m]
    volume: Any  # (m,) of wall particles [m^dim]; None of the liquid's
    start: Any
    count: Any
    entries: Any


class ListedColumns(NamedTuple):
    """The same column by column (GPU)."""

    position: Any
    volume: Any
    count: Any
    entries: Any


def with_list(position: Any, volume: Any, neighbours: Any) -> ListedRows | ListedColumns:
    """Particles together with a list of them, whichever of the two forms it has."""
    if hasattr(neighbours, "start"):
        return ListedRows(position, volume, *neighbours)
    return ListedColumns(position, volume, neighbours.count, neighbours.entries)
