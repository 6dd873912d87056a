"""How liquid lies on a floor, seen from above: its connected parts, the holes in them, its number of layers.

Raster and reach are in particle spacings, so that the counts do not depend on the size of the box.
"""

import itertools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import label
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from refsim.shape_matching.phases import EMPTY

REACH = 1.5  # spacings up to which two particles belong together; the lattice's face diagonal is 1.41
CELL = 0.1  # of the raster, in spacings
SMALLEST_HOLE = 1.0  # in spacings squared: smaller gaps between particles are no holes


def groups(position: ArrayLike, reach: float) -> NDArray[np.int32]:
    """The group (n,) of each particle of position (n, dim); particles within `reach` of each other are of one."""
    points = np.asarray(position, dtype=float)
    pairs = cKDTree(points).query_pairs(reach, output_type="ndarray")
    graph = coo_array((np.ones(len(pairs), dtype=bool), pairs.T), shape=(len(points),) * 2)
    return connected_components(graph, directed=False)[1]


def parts(position: ArrayLike, spacing: float) -> NDArray[np.int64]:
    """Which part of the liquid each particle of position (n, 3) [m] belongs to, (n,); the largest part is 0."""
    part = groups(position, REACH * spacing)
    order = np.argsort(-np.bincount(part), kind="stable")
    return np.argsort(order)[part]


def covered(position: ArrayLike, spacing: float) -> NDArray[np.bool_]:
    """The floor as a raster of 0.1 spacings, true where a disc of half the reach about a particle lies over it.

    A margin of one spacing is free all around, so that the outside is connected.
    """
    points = np.asarray(position, dtype=float)[:, :2] / (CELL * spacing)
    margin = int((1.0 + REACH) / CELL)
    low = np.floor(points.min(0)).astype(int) - margin
    shape = np.ceil(points.max(0)).astype(int) + margin - low
    cells = np.argwhere(np.ones(shape, dtype=bool)) + low + 0.5
    near, _ = cKDTree(points).query(cells, distance_upper_bound=0.5 * REACH / CELL)
    return np.isfinite(near).reshape(shape)


def seen_from_above(position: ArrayLike, spacing: float, many: int = 5) -> dict[str, Any]:
    """Counts of a liquid on a floor, position (n, 3) [m].

    parts      of at least `many` particles; lone: particles without a neighbour; largest: share of the largest part
    holes      in the covered floor, larger than one spacing squared, that do not reach the outside
    area       covered floor, in spacings squared per particle
    stretch    of the parts of at least `many` particles, weighted by them: area of the smallest circle about a part
               over the floor that it covers; about 1 for a round droplet, large for threads and nets
    height     mean height of the liquid over the floor that it covers, in spacings
    """
    points = np.asarray(position, dtype=float)
    part = parts(points, spacing)
    sizes = np.bincount(part)
    floor = covered(points, spacing)
    gaps, number = label(~floor)
    area = np.bincount(gaps.ravel(), minlength=number + 1)[1:] * CELL**2
    outside = gaps[0, 0] - 1
    inside = np.delete(area, outside)
    stretch, weight = 0.0, 0
    for k in np.flatnonzero(sizes >= many):
        part_points = points[part == k]
        middle = 0.5 * (part_points[:, :2].max(0) + part_points[:, :2].min(0))
        radius = np.linalg.norm(part_points[:, :2] - middle, axis=1).max() / spacing + 0.5 * REACH
        stretch += sizes[k] * np.pi * radius**2 / (covered(part_points, spacing).sum() * CELL**2)
        weight += int(sizes[k])
    return {
        "parts": int((sizes >= many).sum()), "lone": int((sizes == 1).sum()), "largest": float(sizes[0] / len(points)),
        "holes": int((inside > SMALLEST_HOLE).sum()), "area": float(floor.sum() * CELL**2 / len(points)),
        "stretch": stretch / weight if weight else float("nan"), "height": float(len(points) / (floor.sum() * CELL**2)),
    }  # fmt: skip


def layers(position: ArrayLike, spacing: float) -> int:
    """Layers that the liquid stands in: one more than the spacings between its lowest and highest particles.

    The outer twentieths do not count.
    """
    low, high = np.quantile(np.asarray(position, dtype=float)[:, 2], (0.05, 0.95))
    return 1 + round(float(high - low) / spacing)


def tunnels(position: NDArray, spacing: float) -> int:
    """Tunnels through a union of balls of 0.85 spacings [m] on a raster: components + cavities - Euler's number.

    A net of strands has many; a closed sheet has none. Tunnels that the solid itself fills count, too.
    """
    from scipy.ndimage import label

    cell, reach = 0.5 * spacing, 0.85 * spacing
    low = position.min(0) - 2 * reach
    shape = np.ceil((position.max(0) + 2 * reach - low) / cell).astype(int) + 1
    if shape.prod() > 3e7:  # flung particles: look at the middle nine tenths
        keep = (np.abs(position - np.median(position, axis=0)) < np.quantile(np.abs(position), 0.95)).all(1)
        return tunnels(position[keep], spacing)
    axes = [low[c] + cell * np.arange(shape[c]) for c in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    near = cKDTree(position).query(points.reshape(-1, 3), distance_upper_bound=reach)[0].reshape(shape) < reach
    filled = np.pad(near, 1)
    components = label(filled, np.ones((3, 3, 3)))[1]
    cavities = label(~filled)[1] - 1
    return int(components + cavities - euler(filled))


def euler(filled: NDArray) -> int:
    """Euler characteristic of a union of closed cubes: corners - edges + faces - cubes."""
    total = 0
    for joined in itertools.product((False, True), repeat=3):  # axes along which a cell of the complex is a joint
        cells = filled
        for axis in np.flatnonzero(joined):
            ahead, behind = (np.delete(cells, end, axis) for end in (0, -1))
            cells = ahead | behind
        total += (-1) ** (3 - sum(joined)) * int(cells.sum())
    return total


def fragments(direct: np.ndarray) -> int:
    """Pieces of solid that are connected over direct neighbours."""
    node, slot = np.nonzero(direct != EMPTY)
    if not len(node):
        return 0
    there = np.unique(node)
    graph = coo_array((np.ones(len(node)), (node, direct[node, slot])), shape=(len(direct),) * 2)
    _, label = connected_components(graph, directed=False)
    return len(np.unique(label[there]))


def pieces(position: NDArray, reach: float) -> NDArray[np.int64]:
    """Sizes of the pieces of a cloud (n, 3) whose particles are nearer than `reach` [m], the largest first."""
    return np.sort(np.bincount(groups(position, reach)))[::-1]
