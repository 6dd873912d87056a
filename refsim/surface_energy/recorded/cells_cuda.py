"""Particles by cell, counted and placed without the host, and what the other kernels of the graph share.

How much there is of anything stands in `counts`. Where a particle stands in no block, or a capacity is exceeded, no
vertices and facets are made, and the host sees why.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import sum_before
from refsim.sparse_grid.block_search_cuda import SUMMING
from refsim.sparse_grid.formulas import cell_coordinate, find_node_near, step_node

CELLS = 64  # of a block, a thread to each
# What `counts` holds: whether a particle is not covered, most particles in a cell, cut edges and facets as found and
# as made (0 where they do not fit), samples without a particle, cells with a point of the fit or a sample
MISSING, MOST, EDGES, FACETS, VERTICES, MADE, UNFOUND, FILLED = range(8)
COUNTS = 8


@cuda_kernel(rows_of="held")
def clear(held, held_points, members, sample_count, counts):
    """Sets to 0 everything that is counted."""
    i = cuda.grid(1)
    if i < held.shape[0]:
        held[i] = 0
        held_points[i] = 0
        members[i] = 0
        if i < counts.shape[0]:
            counts[i] = 0
        for p in range(i, sample_count.shape[0], held.shape[0]):
            sample_count[p] = 0


@formula
def node_at(x, y, z, shift, guess, blocks, surface_term):
    """Node of the cell j = floor(x/h - shift) of a position [m], -1 where no block holds it; block `guess` first."""
    jx = cell_coordinate(x, surface_term.inverse_cell, shift)
    jy = cell_coordinate(y, surface_term.inverse_cell, shift)
    jz = cell_coordinate(z, surface_term.inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
    return find_node_near(blocks, jx, jy, jz, guess)


@cuda_kernel(rows_of="cell")
def count_particles(interior_position, surface_term, blocks, sure, held, place, cell, counts):
    """Cell of each particle, looked for first in the block of the last one, and its number among those of the cell.

    `sure` says of each block whether all blocks in reach of its particles exist.
    """
    i = cuda.grid(1)
    if i < cell.shape[0]:
        x, y, z = interior_position[i, 0], interior_position[i, 1], interior_position[i, 2]
        found = node_at(x, y, z, 0.0, cell[i] >> 6, blocks, surface_term)
        cell[i] = found
        if found < 0 or sure[found >> 6] == 0:
            counts[MISSING] = 1
        if found >= 0:
            place[i] = cuda.atomic.add(held, found, 1)


@cuda_kernel(rows_of="cell")
def fill_particles(interior_position, cell, place, first, point, placed):
    """The particles of each cell, in any order, and their positions [m] side by side."""
    i = cuda.grid(1)
    if i < cell.shape[0] and cell[i] >= 0:
        at = first[cell[i]] + place[i]
        point[at] = i
        for c in range(3):
            placed[at, c] = interior_position[i, c]


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total")
def total_blocks(held, counts, total):
    """Points of each block; with `counts` also the most in a cell."""
    part = cuda.shared.array(CELLS, np.int32)
    thread = cuda.threadIdx.x
    mine = held[CELLS * cuda.blockIdx.x + thread]
    if counts is not None and mine > counts[MOST]:
        cuda.atomic.max(counts, MOST, mine)
    before = sum_before(part, mine)
    if thread == CELLS - 1:
        total[cuda.blockIdx.x] = before + mine


@cuda_formula
def occupied_near(first, blocks, b, lowest_direction, directions):
    """Whether one of the blocks around b holds a point; called by all threads of the thread block."""
    thread = cuda.threadIdx.x
    found = 0
    if thread < directions:
        other = blocks.neighbour[b, lowest_direction + thread]
        if other >= 0 and first[CELLS * other] != first[CELLS * other + CELLS]:
            found = 1
    return cuda.syncthreads_or(found) != 0


@formula
def row_part(i, direction, low, high, dy, dz, blocks, first):
    """(begin, end) of the particles of cells i + (dx, dy, dz), dx from low to high, in the block `direction` along x.

    Cells in a row along x of one block are numbered consecutively, and so are their particles.
    """
    width = 4 if blocks.neighbour.shape[1] == 27 else 8
    x = i & (width - 1)
    begin, end = max(x + low, width * direction), min(x + high, width * direction + width - 1)
    if begin > end:
        return 0, 0
    cell = step_node(blocks, i, begin - x, dy, dz)
    if cell < 0:
        return 0, 0
    return first[cell], first[cell + end - begin + 1]


@cuda_formula
def sum_pairs(part, total):
    """total[b] <- sum over the blocks before b, by one thread block; the last thread returns the sum over all."""
    thread = cuda.threadIdx.x
    size = (total.shape[0] + SUMMING - 1) // SUMMING
    begin, end = min(thread * size, total.shape[0]), min(thread * size + size, total.shape[0])
    own = np.int64(0)
    for b in range(begin, end):
        own += total[b]
    before = sum_before(part, own)
    for b in range(begin, end):
        own = total[b]
        total[b] = before
        before += own
    return before
