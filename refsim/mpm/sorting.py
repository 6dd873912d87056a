"""Cells of points, keys of their blocks, and points by block, on a CPU.

Points are taken in chunks; within a chunk the block of the point before is tried first.
"""

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.reductions import CHUNKS, limits
from refsim.mpm.formulas import base_coordinate
from refsim.mpm.kernels import point_key
from refsim.mpm.limits import FARTHEST
from refsim.neighbours.formulas import lower_bound
from refsim.sparse_grid.block_search import points_by_block
from refsim.sparse_grid.formulas import block_bits, block_key, place_in_block


@formula
def find_chunk(begin, end, position, inverse_cell, keys, complete, bits, cell):
    """`write_cells` for the points from `begin` to `end`; (points outside all blocks, points too far away or NaN)."""
    missing, lost = 0, 0
    last, block = np.int64(-1), np.int64(0)
    for i in range(begin, end):
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        if jx > FARTHEST or jy > FARTHEST or jz > FARTHEST:
            lost += 1
            cell[i] = -1
            continue
        key = block_key(jx, jy, jz, bits)
        if key != last:
            last = key
            block = np.int64(lower_bound(keys, key))
            if block == keys.shape[0] or keys[block] != key or complete[block] == 0:
                block = np.int64(-1)
        if block < 0:
            missing += 1
            cell[i] = -1
        else:
            cell[i] = block * 64 + place_in_block(jx, jy, jz, bits)
    return missing, lost


@kernel(rows_of="counts")
def write_cells(chunk, position, inverse_cell, keys, complete, bits, counts, cell):
    """Cell of each point: number of its base node; -1 outside all blocks. counts[chunk] = (missing, lost)."""
    begin, end = limits(chunk, cell.shape[0])
    counts[chunk, 0], counts[chunk, 1] = find_chunk(begin, end, position, inverse_cell, keys, complete, bits, cell)


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
    write_cells(position, inverse_cell, blocks.keys, complete, block_bits(blocks), counts, cell)
    missing, lost = counts.sum(0)
    return int(missing), int(lost)


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    grid.locate((position, carrier_position, surface_sample), cell, find_cells, block_keys, points_by_block)
