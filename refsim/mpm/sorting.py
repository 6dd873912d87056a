"""Cells of points, keys of their blocks, and points by block, on a CPU.

Points are taken in chunks; within a chunk the block of the point before is tried first.
"""

import numpy as np

from refsim.backends.compile import kernel
from refsim.backends.reductions import CHUNKS, limits
from refsim.mpm.kernels import cell_of, point_key
from refsim.mpm.limits import LOST, OUTSIDE
from refsim.sparse_grid.block_search import points_by_block


@kernel(rows_of="counts")
def write_cells(chunk, position, inverse_cell, blocks, complete, counts, cell):
    """Cell of each point: number of its base node; -1 outside all blocks. counts[chunk] = (missing, lost)."""
    begin, end = limits(chunk, cell.shape[0])
    missing, lost, block = 0, 0, np.int64(-1)
    for i in range(begin, end):
        node = np.int64(cell_of(i, position, inverse_cell, blocks, complete, block))
        if node >= 0:
            block = node >> 6
        elif node == LOST:
            lost += 1
        else:
            missing += 1
        cell[i] = max(node, OUTSIDE)
    counts[chunk, 0], counts[chunk, 1] = missing, lost


@kernel
def write_keys(i, position, inverse_cell, bits, keys):
    """Key of the block of a point at `position` [m]; -1 where it is too far or NaN."""
    keys[i] = point_key(i, position, inverse_cell, bits)


def block_keys(position, inverse_cell, dim):
    """Keys (n,) of the points' blocks."""
    keys = np.empty(len(position), np.int64)
    write_keys(position, inverse_cell, 2 if dim == 3 else 3, keys)
    return keys


def find_cells(position, inverse_cell, blocks, complete, cell):
    """Write the points' cells; (points outside all blocks, points too far away or NaN)."""
    counts = np.zeros((CHUNKS, 2), np.int64)
    write_cells(position, inverse_cell, blocks, complete, counts, cell)
    missing, lost = counts.sum(0)
    return int(missing), int(lost)


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    grid.locate((position, carrier_position, surface_sample), cell, find_cells, block_keys, points_by_block)
