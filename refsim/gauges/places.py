"""Points at which gauges read: a point, a line, a patch; and the highest place of the liquid on a line."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from refsim.core.effect import Discretisation
from refsim.core.errors import InputError

Vector = tuple[float, float, float]
Places = tuple[Vector | None, Vector | None, Vector | None]  # `at`, `lower` and `upper` of a gauge
FINER = 4  # points of a level in a spacing
MOST_POINTS = 10**6  # of a gauge


class Points(NamedTuple):
    """Points of a gauge.

    place  (m, 3) [m]
    area   of each point of a patch [m^(dim - 1)]; 0 of a point and a line
    axis   across the patch, or along the line; -1 of a point
    """

    place: NDArray[np.float64]
    area: float = 0.0
    axis: int = -1


def point(at: Vector, grid: Discretisation) -> Points:
    """One point."""
    return Points(_flat(np.array([at]), grid))


def line(owner: str, given: Places, grid: Discretisation) -> Points:
    """Points along a line, several a spacing. Raises InputError where there is none along one axis."""
    low, high, wide, form = _corners(owner, given, grid)
    if len(wide) != 1:
        raise InputError(f"{form} line along one axis; let lower and upper differ along the axis of the level.")
    (axis,) = wide
    count = max(2, math.ceil(FINER * (high - low)[axis] / grid.spacing) + 1)
    _check_number(owner, count)
    place = np.repeat(low[None, :], count, axis=0)
    place[:, axis] = np.linspace(low[axis], high[axis], count)
    return Points(_flat(place, grid), 0.0, axis)


def patch(owner: str, given: Places, grid: Discretisation) -> Points:
    """Points of a patch, one a spacing. Raises InputError where there is none that is flat along one axis."""
    low, high, wide, form = _corners(owner, given, grid)
    if len(wide) != grid.dim - 1:
        raise InputError(f"{form} patch; let lower and upper be equal along one axis, and differ along the others.")
    cells = [max(1, math.ceil(width / grid.spacing - 1e-9)) for width in high - low]
    _check_number(owner, math.prod(cells))
    axes = [low[a] + (high - low)[a] * (np.arange(n) + 0.5) / n for a, n in enumerate(cells)]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, grid.dim)
    across = next(a for a in range(grid.dim) if a not in wide)
    return Points(_flat(place, grid), math.prod((high - low)[a] / cells[a] for a in wide), across)


def _corners(
    owner: str, given: Places, grid: Discretisation
) -> tuple[NDArray[np.float64], NDArray[np.float64], list[int], str]:
    """Lower and upper corner (dim,) [m], the axes along which they differ, and how a sentence on them begins."""
    _, lower, upper = given
    assert lower is not None
    assert upper is not None
    low, high = np.array(lower)[: grid.dim], np.array(upper)[: grid.dim]
    if (high < low).any():
        raise InputError(f"{owner}: lower is above upper along {'xyz'[int((high < low).argmax())]}.")
    wide = [axis for axis in range(grid.dim) if high[axis] > low[axis]]
    return low, high, wide, f"{owner}: from {list(lower)} to {list(upper)} m is no"


def _check_number(owner: str, count: int) -> None:
    if count > MOST_POINTS:
        raise InputError(f"{owner}: it has {count:,} points, one a spacing; make it smaller.")


def _flat(place: NDArray[np.float64], grid: Discretisation) -> NDArray[np.float64]:
    """Places (m, 3) [m], with z = 0 in 2D."""
    whole = np.zeros((len(place), 3))
    whole[:, : grid.dim] = place[:, : grid.dim]
    return whole


def crossing(height: NDArray[np.float64], fill: NDArray[np.float64]) -> float:
    """Height [m] of the highest crossing of fill 1/2; the lowest height where it is below everywhere.

    height  (m,) [m], rising; fill (m,) of the liquid there
    """
    full = np.flatnonzero(fill >= 0.5)
    if not len(full):
        return float(height[0])
    k = int(full[-1])
    if k == len(height) - 1:
        return float(height[-1])
    share = (fill[k] - 0.5) / (fill[k] - fill[k + 1])
    return float(height[k] + share * (height[k + 1] - height[k]))
