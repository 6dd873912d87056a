"""The fit: points by cell, and sweeps of Algorithm 2.

Sums over points on nodes are taken first over the points of each cell, for all nodes that these reach, and then over
the cells that reach a node. Cells with points are numbered, so that no others are looked at; sums for the k-th node of
cell n are column n of row k, so that neighbouring threads read and write contiguous memory.
"""

from collections import namedtuple

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import behind_last, sum_before, sum_of_lanes, wait_for_last
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import step_node
from refsim.surface_energy import formulas, kernels
from refsim.surface_energy.recorded.cells_cuda import ACTIVE, CELLS, FILLED, MADE

REACHING = 216  # cells that reach a block's nodes: 6 x 6 x 6, or 10 x 10 in the plane
CELL_BIT = 1 << 24  # counts a cell beside its points: the points of 64 cells are fewer than 2^24
PLANES = 4  # threads that share a cell: one for each plane of nodes along z that its points reach, and one more


@cuda_kernel(rows_of="fit_cell", early=True)
def fill_points(fit_cell, fit_place, first, each, counts, unsorted):
    """The points of each cell, in any order; there are `each` points to a sample."""
    r = cuda.grid(1)
    if behind_last(r < each * counts[MADE] and fit_cell[r] >= 0):
        unsorted[first[fit_cell[r]] + fit_place[r]] = r


@formula
def place_in_row(r, cell, first, held, unsorted):
    """Position (dimensionless) of point r in the list of points by cell, in the order of their numbers."""
    begin = first[cell]
    last = begin + held[cell] - 1
    at = begin
    for k in range(begin, last + 1, 4):
        for m in range(4):  # reads that do not wait for each other
            other = unsorted[number(min(k + m, last))]
            if k + m <= last and other < r:
                at += 1
    return at


@cuda_kernel(rows_of="fit_cell", early=True)
def sort_points(fit_position, fit_cell, bins, unsorted, blocks, surface_term, counts, fit_splines, fit_target):
    """Splines (9, points) of the points, cell by cell, and b [h]: 0 at the samples, epsilon at their second points."""
    r = cuda.grid(1)
    if behind_last(r < 2 * counts[MADE] and fit_cell[r] >= 0):
        at = place_in_row(r, fit_cell[r], *bins, unsorted)
        real = type(surface_term.cell_size)
        kernels.put_splines(at, r, fit_position, fit_cell[r], blocks, surface_term, fit_splines.T)
        fit_target[at] = surface_term.offset if r >= counts[MADE] else real(0)


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="held_in_block")
def number_points(held, first, rank, filled, counts, into, held_in_block):
    """First point of each cell, the number of each cell with points, -1 for the others, and points of each block.

    Points stand block by block and cells are numbered so, the blocks in any order; how many cells have points, and how
    many there are, is added to counts[into] and the next.
    """
    part = cuda.shared.array(CELLS, np.int32)
    place = cuda.shared.array(2, np.int32)
    thread = cuda.threadIdx.x
    i = CELLS * cuda.blockIdx.x + thread
    mine = np.int32(held[i])
    own = np.int32(mine + (CELL_BIT if mine > 0 else 0))
    before = sum_before(part, own)
    if thread == CELLS - 1:
        whole = before + own
        held_in_block[cuda.blockIdx.x] = whole & (CELL_BIT - 1)
        if whole > 0:
            place[0] = cuda.atomic.add(counts, into + 1, whole & (CELL_BIT - 1))
            place[1] = cuda.atomic.add(counts, into, whole >> 24)
    cuda.syncthreads()
    first[i] = place[0] + (before & (CELL_BIT - 1))
    n = place[1] + (before >> 24)
    rank[i] = n if mine > 0 else -1
    if mine > 0:
        filled[n] = i


@cuda_formula
def reached_from(held_in_block, blocks, b):
    """Whether a point reaches a node of block b: from itself or a block below; called by the whole thread block."""
    thread = cuda.threadIdx.x
    occupied = 0
    if thread <= blocks.neighbour.shape[1] // 2:  # directions 0 to the middle
        other = blocks.neighbour[b, thread]
        if other >= 0 and held_in_block[other] > 0:
            occupied = 1
    return cuda.syncthreads_or(occupied) != 0


@cuda_kernel(threads=CELLS, lanes=PLANES, early=True)
def sum_fit(bins, fit_splines, fit_target, blocks, coefficients, counts, reached, change, filled):
    """Of each cell's points, for each node k that they reach: sum of B_k, and of (b - B C) B_k in units of h.

    Without `coefficients` C is 0; the first of the sums is left out where `reached` is. A thread takes a plane of nodes
    along z.
    """
    n, plane = cuda.grid(1) // PLANES, cuda.grid(1) % PLANES
    if n < counts[FILLED]:
        cell = filled[n]
        zero = fit_target.dtype.type(0)
        planes = 3 if blocks.neighbour.shape[1] == 27 else 1
        dz = min(plane, planes - 1)
        near, c = cuda.local.array(9, np.int32), cuda.local.array(9, fit_target.dtype)
        total = cuda.local.array(9, fit_target.dtype)
        changed = cuda.local.array(9, fit_target.dtype)
        for k in range(9):
            c[k], total[k], changed[k] = zero, zero, zero
            if coefficients is not None:
                near[k] = step_node(blocks, cell, k % 3, k // 3, dz)
        first, held = bins
        r = number(first[cell])
        last = r + held[cell]
        wait_for_last()
        if coefficients is not None:
            for k in range(9):
                value = coefficients[number(max(near[k], 0))]  # in any case: such reads do not wait for each other
                c[k] = value if near[k] >= 0 else zero
        while r < last:
            x0, x1, x2 = fit_splines[0, r], fit_splines[1, r], fit_splines[2, r]
            z = fit_splines[number(6 + dz), r]
            z = z if plane == dz else zero
            y0, y1, y2 = fit_splines[3, r] * z, fit_splines[4, r] * z, fit_splines[5, r] * z
            residual = fit_target[r]
            if coefficients is not None:
                value = (c[0] * x0 + c[1] * x1 + c[2] * x2) * y0
                value += (c[3] * x0 + c[4] * x1 + c[5] * x2) * y1
                value += (c[6] * x0 + c[7] * x1 + c[8] * x2) * y2
                residual -= sum_of_lanes(value, plane, PLANES)
            for k in range(0, 9, 3):
                across = y0 if k == 0 else (y1 if k == 3 else y2)
                if reached is not None:
                    total[k] += across * x0
                    total[k + 1] += across * x1
                    total[k + 2] += across * x2
                across *= residual
                changed[k] += across * x0
                changed[k + 1] += across * x1
                changed[k + 2] += across * x2
            r += 1
        if plane == dz:
            for k in range(9):
                change[number(9 * plane + k), number(n)] = changed[k]
                if reached is not None:
                    reached[number(9 * plane + k), number(n)] = total[k]
    elif cuda.blockIdx.x == 0:
        wait_for_last()


@cuda_formula
def load_columns(b, rank, first, blocks, sums, near):
    """near[c]: columns of `sums` of the cells that reach the nodes of block b: of its own and of those up to two below.

    The last column for cells without points. All of it is read without a condition, so that reads do not wait for each
    other.
    """
    space = blocks.neighbour.shape[1] == 27
    none = np.int32(sums.shape[1] - 1)
    last = 215 if space else 99
    for turn in range(4):
        c = min(cuda.threadIdx.x + CELLS * turn, last)
        at = np.uint32(c)
        if space:
            z = at // np.uint32(36)
            y = (at - np.uint32(36) * z) // np.uint32(6)
            x = at - np.uint32(36) * z - np.uint32(6) * y
        else:
            z, y = np.uint32(2), at // np.uint32(10)
            x = at - np.uint32(10) * y
        cell = step_node(blocks, CELLS * b, np.int32(x) - 2, np.int32(y) - 2, np.int32(z) - 2)
        found = column_of(number(max(cell, 0)), rank, first)
        near[c] = found if cell >= 0 and found >= 0 else none
    cuda.syncthreads()


@formula
def column_of(cell, rank, first):
    """The column of a cell's sums, int32: its rank, or its first point; -1 for a cell without points."""
    column = np.int32(-1)
    if rank is not None:
        column = rank[cell]
    if first is not None and first[cell + 1] > first[cell]:
        column = first[cell]
    return column


@cuda_formula
def sum_around(near, blocks, first_row, rows, sums):
    """Sum of `sums`[k, cell] over the cells that reach a thread's node, which is the k-th node in reach of the cell.

    With `rows` of them for each k the one after `first_row`. The last column holds zeros. Distances in `near` are
    constant: the address of a term then takes few instructions.
    """
    thread = cuda.threadIdx.x
    total = sums.dtype.type(0)
    if blocks.neighbour.shape[1] == 27:
        lowest = number((thread & 3) + 6 * ((thread >> 2) & 3) + 36 * (thread >> 4))
        for kz in range(3):
            for ky in range(3):
                for kx in range(3):
                    n = near[lowest + (86 - kx - 6 * ky - 36 * kz)]
                    total += sums[rows * (kx + 3 * ky + 9 * kz) + first_row, number(n)]
    else:
        lowest = number((thread & 7) + 10 * (thread >> 3))
        for ky in range(3):
            for kx in range(3):
                total += sums[rows * (kx + 3 * ky) + first_row, number(near[lowest + (22 - kx - 10 * ky)])]
    return total


# Blocks with weights, in any order, by the names of their work arrays: their numbers (blocks,), and the columns
# (blocks, REACHING) of the cells that reach each
Active = namedtuple("Active", "active_block active_columns counts")


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total", early=True)
def begin_fit(held_in_block, rank, blocks, reached, change, surface_term, node_weight, coefficients, active, total):
    """(3.7): 1/sum_r B_i(x_r), 0 where the sum is at most LEAST_SUM, and the first sweep from C = 0."""
    b, thread = cuda.blockIdx.x, cuda.threadIdx.x
    i = CELLS * b + thread
    near = cuda.shared.array(REACHING, np.int32)
    place = cuda.shared.array(1, np.int32)
    real = type(surface_term.cell_size)
    weight, value = real(0), real(0)
    if reached_from(held_in_block, blocks, b):
        load_columns(b, rank, None, blocks, change, near)
        wait_for_last()
        whole = sum_around(near, blocks, 0, 1, reached)
        if whole > real(formulas.LEAST_SUM):
            weight = real(1) / whole
            if surface_term.iterations > 0:
                value = surface_term.relaxation * weight * sum_around(near, blocks, 0, 1, change)
        if cuda.syncthreads_or(1 if weight > real(0) else 0) != 0:
            if thread == 0:
                place[0] = cuda.atomic.add(active.counts, ACTIVE, 1)
            cuda.syncthreads()
            active.active_block[place[0]] = b
            for c in range(thread, REACHING, CELLS):
                active.active_columns[place[0], c] = near[c]
    elif b == 0:
        wait_for_last()
    node_weight[i] = weight
    coefficients[i] = value


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total", early=True)
def correct(blocks, change, surface_term, node_weight, coefficients, active, total):
    """C <- C + w Lambda B^T (b - B C), on a block with weights."""
    if cuda.blockIdx.x < active.counts[ACTIVE]:
        near = cuda.shared.array(REACHING, np.int32)
        for turn in range(4):
            c = number(min(cuda.threadIdx.x + CELLS * turn, REACHING - 1))
            near[c] = active.active_columns[number(cuda.blockIdx.x), c]
        i = number(CELLS * active.active_block[cuda.blockIdx.x] + cuda.threadIdx.x)
        weight = node_weight[i]
        cuda.syncthreads()
        wait_for_last()
        if weight > type(weight)(0):
            whole = sum_around(near, blocks, 0, 1, change)
            coefficients[i] += surface_term.relaxation * weight * whole
    elif cuda.blockIdx.x == 0:
        wait_for_last()
