"""Holes in a 2D liquid: places that no particle is near to and that no air reaches."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import label
from scipy.spatial import cKDTree

CELL = 0.25  # of the spacing: the raster's cells


class Voids(NamedTuple):
    """Holes of a liquid.

    count  number of them
    area   of the places whose distance to every particle is above the radius, in squares of the spacing
    place  (k, 2) [m], the raster's points in them
    """

    count: int
    area: float
    place: NDArray[np.float64]


def find_voids(position: ArrayLike, spacing: float, radius: float, walls: ArrayLike | None = None) -> Voids:
    """Closed holes into which a disc of `radius` [m] fits between the particles' centres, on a raster of d/4.

    position (n, 2) or (n, 3) [m]; walls likewise, they close a hole as particles do. What a disc can reach from outside
    the particles' bounding box, widened by two radii, is air. A square lattice has no hole for radius > 0.71 d.
    """
    x = np.asarray(position, dtype=float)[:, :2]
    solid = x if walls is None else np.vstack([x, np.asarray(walls, dtype=float)[:, :2]])
    cell = CELL * spacing
    low, high = x.min(0) - 3 * radius, x.max(0) + 3 * radius
    axes = [np.arange(a, b + cell, cell) for a, b in zip(low, high)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    away = cKDTree(solid).query(points.reshape(-1, 2))[0].reshape(points.shape[:2])
    empty = away > radius
    parts, _ = label(empty)
    edge = np.concatenate([parts[0], parts[-1], parts[:, 0], parts[:, -1]])
    inside = empty & ~np.isin(parts, np.unique(edge[edge > 0]))
    return Voids(len(np.unique(parts[inside])), float(inside.sum()) * CELL**2, points[inside])
