"""Boxes of displacements on the GPU: whether two particles can have come within the radius, now and steps ahead."""

import math
from functools import partial

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_formula, cuda_kernel, formula, row_kernel
from refsim.backends.primitives import across_lanes, largest_of_block
from refsim.backends.runtime import simulated
from refsim.neighbours.formulas import BITS, lower_bound, squared_between

CELL_LANES = 1 if simulated() else 8  # threads that share a cell
# Boxes of cells that are joined at a time, and threads of a block that joins them
BOXES_JOINED, WIDE = (16, 8) if simulated() else (4096, 512)
LOOK_AHEAD = 16  # steps for which displacements are compared ahead


@row_kernel
def near_cells(place, cells, report, static_cells, capacity, near):
    """near[k * capacity + c] = b: in row k of the rows up to two from cell c, the cells up to two along x begin at b.

    -1 - b where static particles are in a cell of that row, or of the one opposite. Rows are those behind c in the
    order of the cells, and its own: 3 in 2D, 13 in 3D.
    """
    k, c = place // capacity, place % capacity
    if c < report[0]:
        across, along = row_offset(k)
        offset = (across << BITS) + (along << (2 * BITS))
        key = cells[c]
        b = c
        if k > 0:
            b = lower_bound(cells, key + offset - 2)
        if static_cells is not None:
            one, other = key + offset, key - offset
            a, z = lower_bound(static_cells, one - 2), lower_bound(static_cells, other - 2)
            last = static_cells.shape[0]
            if (a < last and static_cells[a] <= one + 2) or (z < last and static_cells[z] <= other + 2):
                b = -1 - b
        near[place] = b


@formula
def row_offset(k):
    """Cells (dimensionless) along y and z from a cell to row k of those behind it."""
    return (k + 12) % 5 - 2, (k + 12) // 5 - 2


@cuda_kernel(rows_of="low", lanes=CELL_LANES)
def cell_boxes(position, build_position, velocity, timestep, first, report, displacements, low, high):
    """Box [low, high] [m] of the displacements of each cell's particles since the list was built.

    Columns 0 to 2 are those of now; 3 to 5 are those after LOOK_AHEAD steps of timestep[1] [s] with the velocities of
    now. Lanes take a cell's particles by turns. The first thread sets the first two displacements to 0.
    """
    k, lane = cuda.grid(1) // CELL_LANES, cuda.grid(1) % CELL_LANES
    if cuda.grid(1) == 0:
        displacements[0], displacements[1] = 0, 0
    if k < high.shape[0] and k < report[0]:
        begin, end = first[k], first[k + 1]
        ahead = type(timestep[1])(LOOK_AHEAD) * timestep[1]
        given = begin, end, lane, ahead, position, build_position, velocity
        x, y, z = box_along(0, *given), box_along(1, *given), box_along(2, *given)
        if lane == 0:  # written when all is read: for the compiler, it might be the same memory
            low[k, 0], high[k, 0], low[k, 3], high[k, 3] = x
            low[k, 1], high[k, 1], low[k, 4], high[k, 4] = y
            low[k, 2], high[k, 2], low[k, 5], high[k, 5] = z


@cuda_formula
def box_along(c, begin, end, lane, ahead, position, build_position, velocity):
    """The least and the largest displacement [m] along axis c of the particles from `begin` to `end`, now and ahead."""
    least = position[begin, c] - build_position[begin, c]
    least_ahead = least + ahead * velocity[begin, c]
    most, most_ahead = least, least_ahead
    for i in range(begin + lane, end, CELL_LANES):
        displacement = position[i, c] - build_position[i, c]
        least = min(least, displacement)
        most = max(most, displacement)
        displacement += ahead * velocity[i, c]
        least_ahead = min(least_ahead, displacement)
        most_ahead = max(most_ahead, displacement)
    least, most = box_of_lanes(lane, least, most)
    least_ahead, most_ahead = box_of_lanes(lane, least_ahead, most_ahead)
    return least, most, least_ahead, most_ahead


@cuda_formula
def box_of_lanes(lane, least, most):
    """The least and the largest of what the lanes hold [m]."""
    step = 1
    while step < CELL_LANES:
        least = min(least, across_lanes(least, lane, CELL_LANES, step))
        most = max(most, across_lanes(most, lane, CELL_LANES, step))
        step *= 2
    return least, most


@cuda_kernel(block_for_each_row=True, threads=WIDE, lanes=6)
def join_boxes(report, low, high, part_low, part_high):
    """The box [m] of each BOXES_JOINED of the report[0] (None: all) boxes; a block to each of the six columns."""
    part, c, thread = cuda.blockIdx.x // 6, cuda.blockIdx.x % 6, cuda.threadIdx.x
    count = low.shape[0]
    if report is not None:
        count = min(count, report[0])
    shared = cuda.shared.array(WIDE, low.dtype)
    least = type(low[0, 0])(math.inf)
    most = -least
    for k in range(part * BOXES_JOINED + thread, min(count, (part + 1) * BOXES_JOINED), WIDE):
        least = min(least, low[k, c])
        most = max(most, high[k, c])
    least = -largest_of_block(shared, -least)
    cuda.syncthreads()
    most = largest_of_block(shared, most)
    if thread == 0:
        part_low[part, c], part_high[part, c] = least, most


@cuda_kernel
def compare_all(low, high, displacements):
    """displacements[2] and [3]: bounds of the relative one [m] of any two particles of a box, now and ahead."""
    k = cuda.grid(1)
    if k < 2:
        displacements[2 + k] = apart(low, high, 0, 0, 3 * k)


@cuda_kernel
def compare_boxes(low, high, cells, report, reach, displacements, near):
    """displacements[0] and [1]: bounds of the relative one [m] of particles in cells up to two apart, now and ahead.

    They are less by what the cells are further apart than `reach` [m], the edge of a cell. Static particles are not
    displaced.
    """
    place = cuda.grid(1)
    capacity = high.shape[0]
    k, c = place // capacity, place % capacity
    now, ahead = reach - reach, reach - reach
    if place < near.shape[0] and c < report[0]:
        across, along = row_offset(k)
        middle = cells[c] + (across << BITS) + (along << (2 * BITS))
        b = near[place]
        if b < 0:
            b = -1 - b
            now, ahead = farthest(low, high, c, 0), farthest(low, high, c, 3)
        while b < report[0] and cells[b] <= middle + 2:
            gap = reach - reach
            between = empty_cells(cells[b] - middle) + empty_cells(across) + empty_cells(along)
            if between > 1:
                gap = (math.sqrt(type(reach)(between)) - type(reach)(1)) * reach
            now = max(now, apart(low, high, c, b, 0) - gap)
            ahead = max(ahead, apart(low, high, c, b, 3) - gap)
            b += 1
    # They only grow: a value read too early costs a reduction of this block and nothing else.
    if cuda.syncthreads_or(np.int32(now > displacements[0] or ahead > displacements[1])) == 0:
        return
    shared = cuda.shared.array(THREADS_PER_BLOCK, low.dtype)
    now = largest_of_block(shared, now)
    cuda.syncthreads()
    ahead = largest_of_block(shared, ahead)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(displacements, 0, now)
        cuda.atomic.max(displacements, 1, ahead)


@formula
def empty_cells(cells):
    """How many cells (dimensionless) lie between two that are up to two cells from each other along an axis."""
    return 1 if abs(cells) == 2 else 0


@formula
def apart(low, high, a, b, first):
    """Largest |u - v| [m] of u in the box of row a and v in that of row b, columns `first` and the two behind."""
    return math.sqrt(squared_between(low, high, a, b, first))


@formula
def farthest(low, high, a, first):
    """Largest |u| [m] of u in the box of row a, columns `first` and the two behind."""
    squared = low[a, first] - low[a, first]
    for c in range(first, first + 3):
        far = max(high[a, c], -low[a, c])
        squared += far * far
    return math.sqrt(squared)


class CellBoxes:
    """Boxes of the displacements of each cell's particles, to see whether two can have come within the radius."""

    def __init__(self, search, position, build_position, velocity, timestep):
        backend, table, static = search.backend, search.lists["own"].queries, search.lists.get("static")
        self.table, self.particles = table, (position, build_position, velocity, timestep)
        capacity, real = table.cells.shape[0], position.dtype
        parts = (capacity + BOXES_JOINED - 1) // BOXES_JOINED
        # of each cell, of as many of them as are joined at a time, of all
        self.boxes = [(backend.empty((n, 6), real), backend.empty((n, 6), real)) for n in (capacity, parts, 1)]
        self.near = backend.empty(capacity * (3 if search.dim == 2 else 13), np.int32)
        self.displacements, self.reach = backend.zeros(4, real), real.type(search.reach)
        self.mirror = device.PinnedCopy(self.displacements)
        self.near_known = self.launched = (
            False  # whether `near` belongs to the list, and `displacements` to the positions
        )
        static_cells = None if static is None else static.table.cells
        self.find = lambda: near_cells(table.cells, table.report, static_cells, capacity, self.near)
        self.first, self.again = (device.CudaGraph(lambda known=known: self._measure(known)) for known in (False, True))

    def _measure(self, known):
        table = self.table
        (low, high), displacements = self.boxes[0], self.displacements
        boxes = partial(cell_boxes, *self.particles, table.first, table.report, displacements, low, high)
        device.side_by_side(boxes, *(() if known else (self.find,)))
        device.side_by_side(
            partial(compare_boxes, low, high, table.cells, table.report, self.reach, displacements, self.near),
            self._compare_all,
        )
        self.mirror.send()

    def _compare_all(self):
        cells, parts, all_of_them = self.boxes
        join_boxes(self.table.report, *cells, *parts)
        join_boxes(None, *parts, *all_of_them)
        compare_all(*all_of_them, self.displacements)

    def launch(self):
        """Compare the present positions; the host does not wait."""
        (self.again if self.near_known else self.first)()
        self.near_known = self.launched = True

    def relative_displacements(self):
        """Bounds [m] now and ahead: of two particles' displacement less the gap between their cells, and of any two."""
        if not self.launched:
            self.launch()
        self.launched = False
        near, near_ahead, anywhere, anywhere_ahead = (float(x) for x in self.mirror.read())
        return (near, anywhere), (near_ahead, anywhere_ahead)

    @property
    def nbytes(self):
        return self.near.nbytes + sum(low.nbytes + high.nbytes for low, high in self.boxes)
