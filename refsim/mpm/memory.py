"""Memory of the background grid and of the surface on it, from the numbers of what they hold."""

from collections.abc import Iterable

import numpy as np

from refsim.backends.arrays import Backend
from refsim.backends.runtime import simulated
from refsim.mpm import operations
from refsim.mpm.grid import NODES, MpmGrid

EACH_TABLE = {2: 9, 3: 27}  # neighbours of a block
TILE = 64 if simulated() else 1024  # cells whose points a thread block of the GPU adds up


def with_room(rows: int) -> int:
    """Rows of an array that grows with the blocks: a quarter more than are needed when it is made."""
    return rows + rows // 4


def blocks_at(position: np.ndarray, dim: int, dtype: str, cell_size: float, backend: str) -> int:
    """Blocks that a grid of `cell_size` [m] makes for particles at `position` (n, 3) [m]."""
    grid = MpmGrid(dim, dtype, cell_size, Backend("numpy"))
    place = np.asarray(position, dtype=dtype)
    return grid.count_blocks(operations.block_keys(place, grid.inverse_cell, dim), backend)


def grid_bytes(
    blocks: int, particles: int, dim: int, dtype: str, backend: str, tension: bool = False, sets: Iterable[int] = (),
) -> int:  # fmt: skip
    """Bytes of the background grid after a step, with so many `blocks` since its first one.

    tension  whether a surface pulls at the nodes
    sets     points in each set beside the particles: embedded points, samples
    """
    real, nodes = np.dtype(dtype).itemsize, NODES * blocks
    reach = {2: 10**2, 3: 6**3}[dim]  # nodes that the particles of a block reach
    on_device = backend == "cuda"
    tables = blocks * (8 + 4 * EACH_TABLE[dim] + 1)  # keys, neighbours, whether complete
    if backend == "numpy":
        return tables + with_room(nodes) * (7 + 3 * tension) * real + sum(4 * s for s in sets)
    arrays = with_room(nodes) * (7 + 3 * tension) * real + with_room(blocks) * 4 * reach * real
    bins = nodes + 1 if on_device else blocks + 1
    lists = sum(4 * (bins + count) for count in (particles, *sets)) + sum(4 * count for count in sets)
    if not on_device:
        return tables + arrays + lists
    counts = 4 * (nodes + -(-nodes // TILE) + 1)  # of each cell, of tiles of cells, of all
    sorting = sum(counts + 8 * count for count in (particles, *sets)) + 4 * with_room(particles)
    return tables + arrays + lists + sorting + with_room(blocks) * 5 * real
