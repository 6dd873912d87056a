"""Particles by cell, counted and placed without the host, and what the other kernels of the graph share.

How much there is of anything stands in `counts`. Where a particle stands in no block, or a capacity is exceeded, no
vertices and facets are made, and the host sees why.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, formula, row_kernel
from refsim.backends.primitives import count_up, set_four
from refsim.backends.tuples import three
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import cell_coordinate, find_node_near, node_coordinates
from refsim.surface_energy import formulas

CELLS = 64  # of a block, a thread to each
# What `counts` holds: whether a particle is not covered, most particles in a cell, cut edges and facets as found and
# as made (0 where they do not fit), samples without a particle, blocks with weights of the fit, cells with points of
# the fit and these points, cells with samples and these
MISSING, MOST, EDGES, FACETS, VERTICES, MADE, UNFOUND, ACTIVE, FILLED, POINTS, SAMPLED, SAMPLES = range(12)
COUNTS = 12


@row_kernel(rows_of="held")
def clear(i, held, held_points, held_samples, members, first, cut_sum, counts):
    """Sets to 0 everything that is counted, and the first place."""
    held[i] = 0
    held_points[i] = 0
    held_samples[i] = 0
    members[i] = 0
    if i < counts.shape[0]:
        counts[i] = 0
    if i < cut_sum.shape[0]:
        cut_sum[i] = 0
    if i == 0:
        first[0] = 0


@formula
def node_at(x, shift, guess, blocks, surface_term):
    """Node of the cell j = floor(x/h - shift) of a position [m], -1 where no block holds it; block `guess` first."""
    jx = cell_coordinate(x[0], surface_term.inverse_cell, shift)
    jy = cell_coordinate(x[1], surface_term.inverse_cell, shift)
    jz = cell_coordinate(x[2], surface_term.inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
    return find_node_near(blocks, jx, jy, jz, guess)


@cuda_formula
def count_point(r, x, guess, blocks, surface_term, held, place, cell):
    """Cell whose nodes point r at x [m] reaches, and its number among those of the cell."""
    found = node_at(x, 0.5, guess, blocks, surface_term)
    cell[r] = found
    if found >= 0:
        place[r] = cuda.atomic.add(held, found, 1)


@row_kernel(rows_of="cell")
def count_particles(i, position, surface_term, blocks, sure, held, place, cell, counts):
    """Cell of each particle, looked for first in the block of the last one, and its number among those of the cell.

    `sure` says of each block whether all blocks in reach of its particles exist.
    """
    found = node_at(three(position, i), 0.0, cell[i] >> 6, blocks, surface_term)
    cell[i] = found
    if found < 0 or sure[found >> 6] == 0:
        counts[MISSING] = 1
    if found >= 0:
        place[i] = count_up(held, found)


@row_kernel(rows_of="cell")
def place_particles(i, position, surface_term, blocks, first, place, cell, point, placed):
    """Particles cell by cell, in any order within one: numbers, and offsets [h] from the lowest node of the block.

    Offsets need no double precision: a search that stays within a few blocks takes their differences.
    """
    if cell[i] >= 0:
        c = number(cell[i])
        at = number(first[c] + place[i])
        point[at] = i
        lowest = node_coordinates(blocks, cell[i] & ~(CELLS - 1))
        x, y, z = formulas.place_over(position, i, lowest, surface_term)
        set_four(placed, at, x, y, z, type(x)(0))


@cuda_formula
def occupied_near(first, blocks, b):
    """Whether one of the blocks around b holds a point; called by all threads of the thread block."""
    thread = cuda.threadIdx.x
    occupied = 0
    if thread < blocks.neighbour.shape[1]:
        other = blocks.neighbour[b, thread]
        if other >= 0 and first[CELLS * other] != first[CELLS * other + CELLS]:
            occupied = 1
    return cuda.syncthreads_or(occupied) != 0


@formula
def local_place(i, bits):
    """(x, y, z) of node or cell i in its block, int32, dimensionless; z = 0 in the plane."""
    if bits == 2:
        return np.int32(i & 3), np.int32((i >> 2) & 3), np.int32((i >> 4) & 3)
    return np.int32(i & 7), np.int32((i >> 3) & 7), np.int32(0)


@formula
def block_start(c, space):
    """The lowest cell along an axis of the block of cell c, counted from one block's lowest, int32, dimensionless."""
    return np.int32(c & ~3) if space else np.int32(c & ~7)


@formula
def row_near(x, x0, x1, dy, dz, surface_term):
    """(first, last) cell of a row near a node at x, int32: from x0 to x1, or -1 to 0 where others are r or more away.

    The row's cells are (dy, dz) from the node, -2 to 1: those at -2 and 1 are h away along an axis.
    """
    squared = surface_term.radius_squared
    if squared <= type(squared)(1 + int(dy == -2 or dy == 1) + int(dz == -2 or dz == 1)):
        x0, x1 = max(x0, -1), min(x1, 0)
    return np.int32(x + x0), np.int32(x + x1)


@formula
def row_parts(b, x0, x1, y, z, blocks, first):
    """((begin, end, start), (begin, end, start)) of the particles of cells (x, y, z), x from x0 to x1, in two blocks.

    Cells are counted from the lowest of block b, int32; the row spans at most two blocks. `start` is the lowest cell
    along x of each. Cells in a row along x of one block are numbered consecutively, and so are their particles. All is
    read without a condition, so that reads do not wait for each other.
    """
    if blocks.neighbour.shape[1] == 27:
        start, width = np.int32(x0 & ~3), 4
        way, row = np.int32(13 + 3 * (y >> 2) + 9 * (z >> 2)), np.int32((y & 3) << 2 | (z & 3) << 4)
        step, last = np.int32(start >> 2), np.int32(min((start >> 2) + 1, 1))
    else:
        start, width = np.int32(x0 & ~7), 8
        way, row = np.int32(4 + 3 * (y >> 3)), np.int32((y & 7) << 3)
        step, last = np.int32(start >> 3), np.int32(min((start >> 3) + 1, 1))
    middle = np.int32(start + width)
    own, next_one = blocks.neighbour[number(b), number(way + step)], blocks.neighbour[number(b), number(way + last)]
    cell, other = np.int32(CELLS * max(own, 0) + row), np.int32(CELLS * max(next_one, 0) + row)
    begin, end = np.int32(first[number(cell + x0 - start)]), np.int32(first[number(cell + min(x1 + 1, middle) - start)])
    low, high = np.int32(first[number(other)]), np.int32(first[number(other + max(x1 + 1 - middle, 0))])
    return (begin, end if own >= 0 else begin, start), (low, high if next_one >= 0 else low, middle)
