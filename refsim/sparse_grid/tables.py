"""Tables of the sparse grid: its blocks of nodes, and points by cell."""

import itertools
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

BITS = 21  # of a block's coordinate in its key
OFFSET = 1 << 20  # of it, so that keys are positive


class Blocks(NamedTuple):
    """Blocks of 64 nodes: 4 x 4 x 4 in space, 8 x 8 in the plane; node 64 b + l is the l-th of block b, x fastest."""

    keys: Any  # (b,) int64, ascending
    neighbour: Any  # (b, 27 or 9) int32, number of the block a step away in each direction, -1 for none


class PointList(NamedTuple):
    """Points by cell: those of cell i are point[first[i] : first[i + 1]], in the order of their numbers."""

    first: Any  # (nodes + 1,) int32
    point: Any  # (points in some block,) int32; on a GPU the end is unused capacity for the others
    cell: Any  # (points,) int32, the cell of each point, -1 for none


def keys_at(block: Any) -> Any:
    """Sortable keys (...) of blocks with integer coordinates (..., 3)."""
    return ((block[..., 2] + OFFSET) << (2 * BITS)) | ((block[..., 1] + OFFSET) << BITS) | (block[..., 0] + OFFSET)


def key_steps(dim: int, axis: Iterable[int]) -> np.ndarray:
    """Differences (ways,) of the keys of blocks that are the steps of `axis` apart along each axis; x runs fastest."""
    along = [list(axis) if c < dim else [0] for c in (2, 1, 0)]
    return np.array([(z << (2 * BITS)) + (y << BITS) + x for z, y, x in itertools.product(*along)], np.int64)


def distinct(keys: np.ndarray) -> np.ndarray:
    """Each key once, ascending; quick for keys in ascending runs."""
    keys = np.sort(keys, kind="stable")
    return keys[np.diff(keys, prepend=keys[:1] - 1) > 0]


def reached(occupied: np.ndarray, dim: int, low: int, high: int) -> np.ndarray:
    """Keys of the blocks that are `low` to `high` blocks from the `occupied` ones along each axis, ascending."""
    occupied = distinct(occupied)
    for axis in range(dim):
        occupied = distinct(((np.arange(low, high + 1) << (BITS * axis))[:, None] + occupied).ravel())
    return occupied


def blocks_of(keys: Any, dim: int, xp: Any = np) -> Blocks:
    """The blocks with these ascending keys, arrays of `xp`, and their neighbours."""
    wanted = keys[:, None] + xp.asarray(key_steps(dim, (-1, 0, 1)))[None, :]
    if not len(keys):
        return Blocks(keys, xp.full(wanted.shape, -1, np.int32))
    place = xp.minimum(xp.searchsorted(keys, wanted.ravel()).reshape(wanted.shape), len(keys) - 1)
    return Blocks(keys, xp.where(keys[place] == wanted, place, -1).astype(np.int32))
