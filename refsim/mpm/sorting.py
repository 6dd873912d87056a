"""Cells of points, keys of their blocks, and points by block, on a CPU.

Points are taken in chunks; within a chunk the block of the point before is tried first.
"""

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, prange
from refsim.mpm.formulas import base_coordinate
from refsim.mpm.grid import FARTHEST
from refsim.mpm.kernels import key_of, write_keys
from refsim.neighbours.formulas import lower_bound
from refsim.sparse_grid.formulas import block_bits

CHUNKS = 64


@formula
def find_chunk(begin, end, position, inverse_cell, keys, complete, bits, cell):
    """`write_cells` for the points from `begin` to `end`; (points outside all blocks, points too far away or NaN)."""
    missing, lost = 0, 0
    last, block = np.int64(-1), np.int64(0)
    rest = (1 << bits) - 1
    for i in range(begin, end):
        jx = base_coordinate(position[i, 0], inverse_cell)
        jy = base_coordinate(position[i, 1], inverse_cell)
        jz = base_coordinate(position[i, 2], inverse_cell) if bits == 2 else 0
        if jx > FARTHEST or jy > FARTHEST or jz > FARTHEST:
            lost += 1
            cell[i] = -1
            continue
        key = key_of(jx, jy, jz, bits)
        if key != last:
            last = key
            block = np.int64(lower_bound(keys, key))
            if block == keys.shape[0] or keys[block] != key or complete[block] == 0:
                block = np.int64(-1)
        if block < 0:
            missing += 1
            cell[i] = -1
        else:
            local = ((jy & rest) << bits) | (jx & rest)
            if bits == 2:
                local |= (jz & rest) << 4
            cell[i] = block * 64 + local
    return missing, lost


@cpu_kernel
def write_cells(position, inverse_cell, keys, complete, bits, counts, cell):
    """Cell of each point: number of its base node; -1 outside all blocks. counts[chunk] = (missing, lost)."""
    n = cell.shape[0]
    for chunk in prange(CHUNKS):
        counts[chunk, 0], counts[chunk, 1] = find_chunk(
            chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS, position, inverse_cell, keys, complete, bits, cell
        )


@cpu_kernel
def expand_runs(first, run_first, begin, at, point):
    """point <- numbers of the points of each block, from its runs of consecutive ones."""
    for b in prange(first.shape[0] - 1):
        for r in range(run_first[b], run_first[b + 1]):
            size = (at[r + 1] if r + 1 < at.shape[0] else point.shape[0]) - at[r]
            for k in range(size):
                point[at[r] + k] = begin[r] + k


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


def sorted_bins(cell, blocks):
    """Points by block: sorts runs of consecutive points in the same block, few if particles are in order in memory."""
    block = cell >> 6
    n = len(block)
    begin = np.concatenate(([0], np.flatnonzero(block[1:] != block[:-1]) + 1))[: n or 0].astype(np.int32)
    owner = block[begin]
    size = np.diff(np.append(begin, n))
    order = np.argsort(owner, kind="stable")
    first = np.zeros(blocks + 1, np.int32)
    run_first = np.zeros(blocks + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(owner, weights=size, minlength=blocks))
    run_first[1:] = np.cumsum(np.bincount(owner, minlength=blocks))
    begin, size = begin[order], size[order]
    point = np.empty(n, np.int32)
    expand_runs(first, run_first, begin, (np.cumsum(size) - size).astype(np.int32), point)
    return first, point


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    sets = {"particles": position, "carriers": carrier_position, "samples": surface_sample}
    grid.locate(sets, cell, find_cells, block_keys, sorted_bins)


def by_owner(sample_owner, count):
    """(numbers of the samples by owner, place of the first of each owner and the total), int32, stable."""
    first = np.zeros(count + 1, np.int32)
    first[1:] = np.cumsum(np.bincount(sample_owner, minlength=count))
    return np.argsort(sample_owner, kind="stable").astype(np.int32), first
