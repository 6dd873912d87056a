"""Generalised winding number of a triangle mesh about points (Jacobson, Kavan & Sorkine-Hornung 2013).

It is 1 inside a closed mesh and 0 outside, 2 where two bodies overlap, and between whole numbers near a hole. Triangles
near a point are summed one by one, those farther away in clusters, by the first term of Barill et al. 2018.
"""

from typing import Any, NamedTuple

import numpy as np

FAR = 3.0  # radii of a cluster from its middle: beyond, it counts as one dipole
LEAST = 16  # triangles of a cluster


class Clusters(NamedTuple):
    """A mesh's triangles in clusters as the kernels take them; those of cluster c are first[c] to first[c + 1]."""

    middle: Any  # (c, 3) weighted by area [m]
    dipole: Any  # (c, 3) sum of the triangles' area vectors [m^2]
    reach: Any  # (c,) distance beyond which the dipole counts [m]
    first: Any  # (c + 1,) int32
    corner: Any  # (t, 9) corners a, b, c [m]


def by_halves(points: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """(order (n,) of points (n, 3), first (k + 1,) of each group): halved across the longest side of their box, until
    no group has more than `size`."""
    order, first = np.arange(len(points)), np.array([0, len(points)])
    while len(points) and np.diff(first).max() > size:
        place = points[order]
        side = np.maximum.reduceat(place, first[:-1]) - np.minimum.reduceat(place, first[:-1])
        group = np.repeat(np.arange(len(first) - 1), np.diff(first))
        along = place[np.arange(len(place)), side.argmax(1)[group]]
        sort = np.argsort(along, kind="stable")
        order = order[sort[np.argsort(group.astype(np.min_scalar_type(len(first)))[sort], kind="stable")]]
        first = np.unique(np.concatenate([first, (first[:-1] + first[1:] + 1) // 2]))
    return order, first


def clusters(corners: np.ndarray, dtype: str) -> Clusters:
    """Clusters of triangles (t, 3, 3) [m], about sqrt(t)/4 in each.

    A point then meets about as many clusters as single triangles.
    """
    corners = np.asarray(corners, dtype=dtype).astype(float)
    order, first = by_halves(corners.mean(1), max(LEAST, round(np.sqrt(len(corners)) / 4)))
    corners = corners[order]
    group = np.repeat(np.arange(len(first) - 1), np.diff(first))
    across = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(across, axis=1)
    area = np.where(np.bincount(group, area)[group] > 0, area, 1.0)
    weight = area / np.bincount(group, area)[group]
    center, dipole = np.zeros((len(first) - 1, 3)), np.zeros((len(first) - 1, 3))
    for axis in range(3):
        center[:, axis] = np.bincount(group, weight * corners[:, :, axis].mean(1), len(center))
        dipole[:, axis] = np.bincount(group, across[:, axis], len(center))
    radius = np.zeros(len(center))
    np.maximum.at(radius, group, np.linalg.norm(corners - center[group, None], axis=2).max(1))
    return Clusters(
        center.astype(dtype), dipole.astype(dtype), (FAR * radius).astype(dtype), first.astype(np.int32),
        corners.reshape(-1, 9).astype(dtype),
    )  # fmt: skip
