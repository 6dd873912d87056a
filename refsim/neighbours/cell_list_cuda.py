"""Cell sort and neighbour list on the GPU: columns, so that neighbouring threads read neighbouring words."""

import math
from functools import partial

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import across_lanes, four_of, largest_of_block, set_four, sum_before_lane
from refsim.backends.runtime import simulated
from refsim.core.errors import RunStopped
from refsim.neighbours.formulas import (
    BITS,
    at_bounds,
    key_of_place,
    lower_bound,
    periodic_cells,
    periodic_row,
    to_nearest_image,
)
from refsim.neighbours.limits import MOST_NEIGHBOURS, PARTICLES_PER_CELL, with_margin
from refsim.neighbours.rows import NeighbourColumns, cuda_lane

# Threads that share a column if there are few particles: with one thread each the device would wait for memory. One in
# the simulator, which has no ballots.
LANES, FEW = 1 if simulated() else 4, 500_000
ROWS_TOGETHER = 1 if simulated() else 8  # threads that audit a particle
CELL_LANES = 1 if simulated() else 8  # threads that share a cell
# Boxes of cells that are joined at a time, and threads of a block that joins them
BOXES_JOINED, WIDE = (16, 8) if simulated() else (4096, 512)
LOOK_AHEAD = 16  # steps for which displacements are compared ahead
FARTHEST = (1 << 63) - 1  # above every cell's key


@cuda_kernel(rows_of="keys")
def cell_keys(position, inverse_cell, periodic, keys, begins):
    """Cell key of every position; `inverse_cell` [1/m] in float64, `periodic` the cells of a periodic box or None.

    begins[i] = 1 where particle i is the first of its cell, for particles that stand in cell order; None otherwise.
    """
    i = cuda.grid(1)
    if i < keys.shape[0]:
        key = key_of_place(position[i, 0], position[i, 1], position[i, 2], inverse_cell, periodic)
        keys[i] = key
        if begins is not None:
            j = max(i - 1, 0)
            before = key_of_place(position[j, 0], position[j, 1], position[j, 2], inverse_cell, periodic)
            begins[i] = i == 0 or key != before


@cuda_kernel
def occupied_cells(keys, cells, first, report, run):
    """Keys of the occupied cells and the first particle of each, behind which n and keys beyond all others stand.

    `run` (n,) counts the cells up to each particle. report[0] is the number of cells, also if the
    capacity is exceeded.
    """
    i = cuda.grid(1)
    n = run.shape[0]
    if i < n:
        found = run[n - 1]
        capacity = cells.shape[0]
        cell = run[i] - 1
        if cell < capacity and (i == 0 or keys[i] != keys[i - 1]):
            cells[cell] = keys[i]
            first[cell] = i
        if found + i < capacity:
            cells[found + i] = FARTHEST
        if i == 0:
            report[0] = found
            report[3] += 1
            if found <= capacity:
                first[found] = n


@cuda_kernel(lanes=9)
def cell_ranges(cells, first, query_cells, query_report, periodic, low, high):
    """Sources in the cells around each query cell: three cells in a row of x are one range [low, high).

    `cells` are the sorted keys of the occupied source cells, `first` their first source; `low` and `high` have a
    column for each row of cells around a cell (3 in 2D, 9 in 3D), and each a thread. With the cells of a `periodic` box
    they have twice as many columns, for pieces of rows on the other side of the box.
    """
    i, k = cuda.grid(1) // 9, cuda.grid(1) % 9
    if periodic is not None:
        rows = low.shape[1] // 2
        if i < high.shape[0] and i < query_report[0] and k < rows:
            for piece in range(2 * k, 2 * k + 2):
                least, most = periodic_row(query_cells[i], piece, rows // 3, periodic)
                a = lower_bound(cells, least)
                b = a
                while b < cells.shape[0] and cells[b] <= most:
                    b += 1
                low[i, piece] = first[a]
                high[i, piece] = first[b]
    elif i < high.shape[0] and i < query_report[0] and k < low.shape[1]:
        middle = query_cells[i] + ((k % 3 - 1) << BITS)
        if low.shape[1] == 9:
            middle += (k // 3 - 1) << (2 * BITS)
        a = lower_bound(cells, middle - 1)
        b = a
        while b < cells.shape[0] and cells[b] <= middle + 1:
            b += 1
        low[i, k] = first[a]
        high[i, k] = first[b]


@cuda_kernel(rows_of="source")
def pack_places(source, placed):
    """placed[i] = (x, y, z, 0) of the source [m], which a thread reads at once."""
    i = cuda.grid(1)
    if i < source.shape[0]:
        set_four(placed, i, source[i, 0], source[i, 1], source[i, 2], placed.dtype.type(0))


@cuda_kernel(rows_of="query", lanes="listed")
def build_list(query, run, low, high, placed, radius, exclude_self, period, report, listed):
    """Write each query's sources within `radius` [m] into its column of the list, up to its capacity.

    run[i] - 1 is the row of `low` and `high` that holds query i's ranges. The list's `count` says how many there are,
    also if the capacity is exceeded; report[1] is the largest count so far. Each lane looks at four sources in a row
    before it writes: what it reads is then on its way together, and the lanes count what they found once for four.
    """
    i, lane = cuda_lane(cuda.grid(1), listed)
    lanes = len(listed.lanes)
    n = query.shape[0]
    if i < n and run[i] <= low.shape[0]:
        capacity = listed.entries.shape[0] // n
        limit = radius * radius
        c = run[i] - 1
        x, y, z = query[i, 0], query[i, 1], query[i, 2]
        own = i if exclude_self != 0 else -1
        found = 0
        for k in range(low.shape[1]):
            end = high[c, k]  # read once: for the compiler, `entries` might be the same memory
            for begin in range(low[c, k], end, 4 * lanes):
                j = begin + 4 * lane
                first = near_source(placed, j, end, own, x, y, z, limit, period)
                second = near_source(placed, j + 1, end, own, x, y, z, limit, period)
                third = near_source(placed, j + 2, end, own, x, y, z, limit, period)
                fourth = near_source(placed, j + 3, end, own, x, y, z, limit, period)
                before, together = sum_before_lane(first + second + third + fourth, lane, lanes)
                at = found + before
                write_found(i, n, j, first, at, capacity, listed)
                at += first
                write_found(i, n, j + 1, second, at, capacity, listed)
                at += second
                write_found(i, n, j + 2, third, at, capacity, listed)
                at += third
                write_found(i, n, j + 3, fourth, at, capacity, listed)
                found += together
        if lane == 0:
            listed.count[i] = found
            if found > report[1]:
                cuda.atomic.max(report, 1, found)


@cuda_formula
def near_source(placed, j, end, own, x, y, z, limit, period):
    """1 if source j, before `end` and not `own`, is nearer to x, y, z than the root of `limit` [m^2], else 0."""
    xj, yj, zj, _ = four_of(placed, min(j, end - 1))
    dx, dy, dz = to_nearest_image(x - xj, y - yj, z - zj, period)
    return np.int32(1 if dx * dx + dy * dy + dz * dz < limit and j < end and j != own else 0)


@formula
def write_found(i, n, j, near, at, capacity, listed):
    """Source j becomes entry `at` of column i, if it is near and the column has so many."""
    if near != 0 and at < capacity:
        listed.entries[at * n + i] = j


@cuda_kernel
def near_cells(cells, report, static_cells, capacity, near):
    """near[k * capacity + c] = b: in row k of the rows up to two from cell c, the cells up to two along x begin at b.

    -1 - b where static particles are in a cell of that row, or of the one opposite. Rows are those behind c in the
    order of the cells, and its own: 3 in 2D, 13 in 3D.
    """
    place = cuda.grid(1)
    k, c = place // capacity, place % capacity
    if place < near.shape[0] and c < report[0]:
        across, along = row_offset(k)
        offset = (across << BITS) + (along << (2 * BITS))
        own = cells[c]
        b = c
        if k > 0:
            b = lower_bound(cells, own + offset - 2)
        if static_cells is not None:
            one, other = own + offset, own - offset
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
        for c in range(3):
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
            if lane == 0:
                low[k, c], high[k, c] = least, most
                low[k, c + 3], high[k, c + 3] = least_ahead, most_ahead


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
    """The box [m] of each BOXES_JOINED boxes; a block to each of the six columns.

    There are report[0] boxes, or with None as many as `low` has rows.
    """
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
    if place < near.shape[0] and c < report[0]:
        across, along = row_offset(k)
        middle = cells[c] + (across << BITS) + (along << (2 * BITS))
        b = near[place]
        now, ahead = reach - reach, reach - reach
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
        if now > displacements[0]:
            cuda.atomic.max(displacements, 0, now)
        if ahead > displacements[1]:
            cuda.atomic.max(displacements, 1, ahead)


@formula
def empty_cells(cells):
    """How many cells (dimensionless) lie between two that are up to two cells from each other along an axis."""
    return 1 if abs(cells) == 2 else 0


@formula
def apart(low, high, a, b, first):
    """Largest |u - v| [m] of u in the box of row a and v in that of row b, columns `first` and the two behind."""
    squared = low[a, first] - low[a, first]
    for c in range(first, first + 3):
        difference = max(high[a, c] - low[b, c], high[b, c] - low[a, c])
        squared += difference * difference
    return math.sqrt(squared)


@formula
def farthest(low, high, a, first):
    """Largest |u| [m] of u in the box of row a, columns `first` and the two behind."""
    squared = low[a, first] - low[a, first]
    for c in range(first, first + 3):
        far = max(high[a, c], -low[a, c])
        squared += far * far
    return math.sqrt(squared)


@formula
def squared_distance_before(i, j, position, velocity, drift, period):
    """|x_i - x_j|^2 [m^2] a time `drift` [s] ago."""
    dx = (position[i, 0] - drift * velocity[i, 0]) - (position[j, 0] - drift * velocity[j, 0])
    dy = (position[i, 1] - drift * velocity[i, 1]) - (position[j, 1] - drift * velocity[j, 1])
    dz = (position[i, 2] - drift * velocity[i, 2]) - (position[j, 2] - drift * velocity[j, 2])
    dx, dy, dz = to_nearest_image(dx, dy, dz, period)
    return dx * dx + dy * dy + dz * dz


@formula
def known_before(i, j, position, bounds):
    """Whether both particles' places before the latest step follow from their velocities."""
    if bounds is not None:
        return not (at_bounds(i, position, bounds) or at_bounds(j, position, bounds))
    return True


@cuda_kernel(rows_of="position", lanes=ROWS_TOGETHER)
def count_missed(position, velocity, timestep, bounds, period, neighbours, share, number, radius, report):
    """Add to report[2] the neighbours nearer than `radius` [m] that sampled rows of the list lack.

    The rows are `number`, one out of each `share`, taken by the lanes by turns; which one follows from the number of
    lists built, report[3]. The
    list was last used at position - timestep[1] * velocity, before the latest step; where that is not known, because
    a plane of `bounds` stopped the particle, its pairs are left out.
    """
    j, lane = cuda.grid(1) // ROWS_TOGETHER, cuda.grid(1) % ROWS_TOGETHER
    if j < position.shape[0]:
        limit = radius * radius
        first_row = report[3] * 7919 % share
        drift = timestep[1]
        for k in range(lane, number, ROWS_TOGETHER):
            i = first_row + k * share
            if j < neighbours.count[i]:  # thread j also looks at the row's j-th entry
                other = neighbours.entries[j * position.shape[0] + i]
                if known_before(i, other, position, bounds):  # noqa: SIM102
                    if squared_distance_before(i, other, position, velocity, drift, period) < limit:
                        cuda.atomic.add(report, 2, -1)
            if i == j or not known_before(i, j, position, bounds):
                continue
            if squared_distance_before(i, j, position, velocity, drift, period) < limit:
                cuda.atomic.add(report, 2, 1)


@cuda_kernel
def clear_counts(report, count):
    """No particle in any cell, and a box without cells."""
    k = cuda.grid(1)
    if k < count.shape[0]:
        count[k] = 0
    if k < report.shape[0]:
        report[k] = -(1 << 30)
    if k == 6:
        report[k] = 0


@cuda_kernel(rows_of="keys")
def box_of_cells(keys, report):
    """The greatest of -x, -y, -z, x, y, z of the particles' cells."""
    i, t = cuda.grid(1), cuda.threadIdx.x
    most = cuda.shared.array(6, np.int32)
    if t < 6:
        most[t] = -(1 << 30)
    cuda.syncthreads()
    if i < keys.shape[0]:
        for c in range(3):
            own = (keys[i] >> (BITS * c)) & ((1 << BITS) - 1)
            cuda.atomic.max(most, c, -own)
            cuda.atomic.max(most, c + 3, own)
    cuda.syncthreads()
    if t < 6:
        cuda.atomic.max(report, t, most[t])


@formula
def place_in_box(key, report):
    """Number of a cell, given by its key, among those of the box, in the order of the keys."""
    mask = (1 << BITS) - 1
    wide, deep = np.int64(report[3]) + report[0] + 1, np.int64(report[4]) + report[1] + 1
    plane = (key >> (2 * BITS)) + report[2]
    return (plane * deep + ((key >> BITS) & mask) + report[1]) * wide + (key & mask) + report[0]


@cuda_kernel(rows_of="keys")
def count_cells(keys, report, count, cell, slot):
    """The cell of each particle among those of the box, and which of its particles it is, in whatever order they come.

    report[6] becomes 1 if the cells exceed the capacity of `count`, or a cell has too many particles to be ordered.
    """
    i = cuda.grid(1)
    if i < keys.shape[0]:
        wide, deep = np.int64(report[3]) + report[0] + 1, np.int64(report[4]) + report[1] + 1
        high = np.int64(report[5]) + report[2] + 1
        cell[i] = 0
        slot[i] = 0
        if wide > count.shape[0] or wide * deep > count.shape[0] or wide * deep * high > count.shape[0]:
            report[6] = 1
        else:
            own = place_in_box(keys[i], report)
            cell[i] = own
            slot[i] = cuda.atomic.add(count, own, 1)
            if slot[i] >= MOST_NEIGHBOURS:
                report[6] = 1


@cuda_kernel
def fill_buckets(cell, slot, count, run, report, bucket):
    """The particles of each cell one after the other, in whatever order they came."""
    i = cuda.grid(1)
    if i < bucket.shape[0] and report[6] == 0:
        bucket[run[cell[i]] - count[cell[i]] + slot[i]] = i


@cuda_kernel
def order_buckets(cell, count, run, report, bucket, order):
    """Order of the particles: each behind those of its cell that have smaller numbers."""
    i = cuda.grid(1)
    if i < order.shape[0]:
        if report[6] == 0:
            end = run[cell[i]]
            first = end - count[cell[i]]
            place = first
            for k in range(first, end):
                if bucket[k] < i:
                    place += 1
            order[place] = i
        else:
            order[i] = i


class CellTable:
    """Occupied cells of particles in cell order; its capacity grows until they fit."""

    def __init__(self, backend, inverse_cell, position, periodic=None):
        n = position.shape[0]
        self.backend, self.periodic = backend, periodic
        self.keys = backend.empty(n, np.int64)
        self.begins, self.run = backend.empty(n, np.int32), backend.empty(n, np.int32)
        # Cells of this table; of the list built with it most neighbours, those that audits found missing, and builds.
        self.report = backend.zeros(4, np.int32)
        self.set_capacity(n // PARTICLES_PER_CELL + 8)
        self.position, self.inverse_cell = position, inverse_cell
        self.add_up = device.RunningSum(self.begins, self.run)

    def set_capacity(self, cells):
        self.cells = self.backend.empty(cells, np.int64)
        self.backend.assign(self.cells, FARTHEST)  # entries beyond the occupied cells keep this value
        self.first = self.backend.zeros(cells + 1, np.int32)

    def fill(self):
        """Number the cells and list them; launches only, which can be recorded."""
        cell_keys(self.position, self.inverse_cell, self.periodic, self.keys, self.begins)
        self.add_up()
        occupied_cells(self.keys, self.cells, self.first, self.report, self.run)

    def fits(self):
        return int(self.backend.host(self.report)[0]) <= self.cells.shape[0]

    @property
    def nbytes(self):
        return sum(a.nbytes for a in (self.keys, self.begins, self.run, self.cells, self.first))


class ListOf:
    """The list of one set of sources around one array of positions, with all its buffers.

    table  the sources' cells; None for the particles among themselves
    known  the particles' cells, where another list has found them
    """

    def __init__(self, search, position, source, table, known=None):
        n = position.shape[0]
        self.search, self.backend = search, search.backend
        self.position, self.source, self.table, self.known = position, source, table, known
        self.queries = known or CellTable(search.backend, 1.0 / search.reach, position, search.periodic)
        if table is None:
            self.table = self.queries
        self.report = self.queries.report if known is None else self.backend.zeros(4, np.int32)
        self.mirror = device.Mirror(self.report)
        self.most = self.missed = 0
        self.ready = False  # whether it was built with another list
        lanes = (np.int32(0),) * (LANES if n < FEW else 1)
        self.listed = NeighbourColumns(self.backend.zeros(n, np.int32), self.backend.empty(1, np.uint32), lanes)
        self.placed = self.backend.empty((source.shape[0], 4), position.dtype)
        if known is not None or table is not None:  # sources that do not move
            pack_places(self.source, self.placed)
        self._make_ranges()

    def _make_ranges(self):
        rows = (3 if self.search.dim == 2 else 9) * (1 if self.search.period is None else 2)
        shape = (self.queries.cells.shape[0], rows)
        self.low, self.high = self.backend.empty(shape, np.int32), self.backend.empty(shape, np.int32)

    def find_cells(self):
        """Find the occupied cells of the queries, where no other list does; launches only."""
        if self.table is self.queries:
            device.side_by_side(self.queries.fill, lambda: pack_places(self.source, self.placed))
        elif self.known is None:
            self.queries.fill()

    def launch(self):
        """Build the list behind `find_cells`; launches only."""
        queries, table, search = self.queries, self.table, self.search
        cell_ranges(table.cells, table.first, queries.cells, queries.report, search.periodic, self.low, self.high)
        radius = self.position.dtype.type(search.reach)
        exclude_self = int(self.table is self.queries)
        build_list(
            self.position, queries.run, self.low, self.high, self.placed, radius, exclude_self, search.period,
            self.report, self.listed,
        )  # fmt: skip
        self.mirror.send()

    def fits(self):
        """Whether the capacities sufficed for the list just built, which the host has waited for; else enlarge them."""
        n = self.position.shape[0]
        cells, self.most, self.missed, _ = (int(x) for x in self.mirror.values)
        if self.known is None and cells > self.queries.cells.shape[0]:
            self.queries.set_capacity(cells + cells // 8)
        if self.low.shape[0] != self.queries.cells.shape[0]:
            self._make_ranges()
            return False
        if self.most * n > self.listed.entries.shape[0] and self.most <= MOST_NEIGHBOURS:
            self.listed = self.listed._replace(entries=self._grown(n, self.most))
            return False
        return True

    @property
    def result(self):
        """(list, most neighbours of any list so far); the same list object while its arrays stay."""
        return self.listed, self.most

    def _grown(self, n, most):
        """Allocate a list of capacity `most`, with a margin, for each of `n` particles.

        Raises RunStopped if memory is exhausted.
        """
        columns = with_margin(most)
        self.listed = self.listed._replace(entries=self.backend.empty(1, np.uint32))
        free = device.free_bytes()
        if 4 * columns * n > free:
            raise RunStopped(
                "out_of_memory",
                f"The neighbour list needs {columns} columns of {n} particles, {4e-9 * columns * n:.3g} GB, and the"
                f" device has {1e-9 * free:.3g} GB left; take fewer particles or a smaller support radius.",
            )
        return self.backend.empty(columns * n, np.uint32)

    @property
    def nbytes(self):
        own = (self.low, self.high, self.listed.count, self.listed.entries, self.placed)
        return (self.queries.nbytes if self.known is None else 0) + sum(a.nbytes for a in own)


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
        self.mirror = device.Mirror(self.displacements)
        self.found = self.launched = False  # whether `near` belongs to the list, and `displacements` to the positions
        static_cells = None if static is None else static.table.cells
        self.find = lambda: near_cells(table.cells, table.report, static_cells, capacity, self.near)
        self.first, self.again = (device.Recorded(lambda found=found: self._measure(found)) for found in (False, True))

    def _measure(self, found):
        table = self.table
        (low, high), displacements = self.boxes[0], self.displacements
        boxes = partial(cell_boxes, *self.particles, table.first, table.report, displacements, low, high)
        device.side_by_side(boxes, *(() if found else (self.find,)))
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
        (self.again if self.found else self.first)()
        self.found = self.launched = True

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


class CellOrder:
    """The particles' order by cell, and within a cell by number, as launches that can be recorded.

    Counts the particles of each cell in the box of cells around all of them. If the cells exceed the capacity, or a
    cell has more particles than MOST_NEIGHBOURS, the particles keep their order and report[6] is 1.
    """

    def __init__(self, backend, keys, order):
        n = keys.shape[0]
        self.keys, self.order = keys, order
        self.cell, self.slot, self.bucket = (backend.empty(n, np.int32) for _ in range(3))
        self.count, self.run = backend.empty(n + 64, np.int32), backend.empty(n + 64, np.int32)
        self.report = backend.zeros(
            7, np.int32
        )  # greatest of -x, -y, -z, x, y, z of the cells; whether a capacity is short
        self.add_up = device.RunningSum(self.count, self.run)

    def launch(self):
        clear_counts(self.report, self.count)
        box_of_cells(self.keys, self.report)
        count_cells(self.keys, self.report, self.count, self.cell, self.slot)
        self.add_up()
        fill_buckets(self.cell, self.slot, self.count, self.run, self.report, self.bucket)
        order_buckets(self.cell, self.count, self.run, self.report, self.bucket, self.order)

    @property
    def nbytes(self):
        return sum(a.nbytes for a in (self.cell, self.slot, self.bucket, self.count, self.run))


class Sorter:
    """Puts arrays into cell order, in place."""

    def __init__(self, search, position, arrays, sorted_position, behind):
        backend, n = search.backend, position.shape[0]
        self.keys, self.order = backend.empty(n, np.int64), backend.empty(n, np.int64)
        self.rows = device.Rows(arrays, self.order)
        self.by_count = CellOrder(backend, self.keys, self.order) if n else None
        self.mirror = None if self.by_count is None else device.Mirror(self.by_count.report)
        self.all = device.Recorded(lambda: self._sort(position, 1.0 / search.reach, search.periodic, sorted_position))
        self.move = device.Recorded(lambda: self._move(position, sorted_position))
        # Whether the host has yet to see whether counting gave an order, and whether it did the last time
        self.open, self.suffices = False, True
        self.beside, self.behind = None, behind

    def _sort(self, position, inverse_cell, periodic, sorted_position):
        def find_order():
            cell_keys(position, inverse_cell, periodic, self.keys, None)
            self.by_count.launch()
            self.mirror.send()

        device.side_by_side(find_order, *(() if self.beside is None else (self.beside,)))
        self._move(position, sorted_position)

    def _move(self, position, sorted_position):
        self.rows.launch()
        device.copy(position, sorted_position)
        if self.behind is not None:
            self.behind()

    def __call__(self, beside):
        """Sort; `beside` is launched before the particles are moved, unless None."""
        if self.by_count is not None:
            if beside is not self.beside:
                self.beside, self.all = beside, self.all.renewed()
            self.all()
            self.open = True
            if not self.suffices:
                self.mirror.read()
                self.ended()

    def ended(self):
        """Whether the particles are in order, once the host has waited for the sorting; else they are put into it."""
        if not self.open:
            return True
        self.open, self.suffices = False, not self.mirror.values[6]
        if self.suffices:
            return True
        device.stable_order(self.keys, self.order)
        self.move()
        return False

    @property
    def nbytes(self):
        counted = 0 if self.by_count is None else self.by_count.nbytes
        return counted + self.keys.nbytes + self.order.nbytes + self.rows.nbytes


class CellSearch:
    """Host side of the GPU search. Buffers belong to the arrays that they were made for, so that launches on them are
    recorded once and replayed."""

    looks_ahead, steps_ahead = True, LOOK_AHEAD

    def __init__(self, backend, dim, reach, log, period=None):
        self.backend, self.dim, self.reach, self.log = backend, dim, reach, log
        self.period, self.periodic = period, periodic_cells(period, reach)
        self.lists = {}
        self.sorter = self.boxes = self.auditor = None
        self.together = (), None  # lists that are built in one graph, and the graph
        self.counted = ()  # whose bytes the log has
        self.wanted = False  # whether an audit is to be launched with the next sorting

    def order(self, position):
        keys = self.backend.empty(position.shape[0], np.int64)
        cell_keys(position, 1.0 / self.reach, self.periodic, keys, None)
        return device.stable_order(keys)

    def sort(self, position, arrays, sorted_position, behind):
        if self.sorter is None or not self.sorter.rows.belongs_to(arrays):
            self.sorter = Sorter(self, position, arrays, sorted_position, behind)
        self.sorter(self._taken_audit())
        return arrays

    def finish_sort(self):
        """Wait for the sorting; `build` does so itself."""
        if self.sorter.open:
            self.sorter.mirror.read()
            self.sorter.ended()

    def static_set(self, position):
        position = self.backend.asarray(position)
        order = self.order(position)
        moved = self.reorder(position, order)
        table = CellTable(self.backend, 1.0 / self.reach, moved, self.periodic)
        table.fill()
        if not table.fits():
            table.set_capacity(int(self.backend.host(table.report)[0]))
            table.fill()
        return (moved, table), self.backend.host(order), moved

    def build(self, position):
        own = self._held("own", position, position, None)
        static = self.lists.get("static")
        if static is not None and static.known is own.queries:  # built with it: it is wanted next
            self._build(own, static)
            static.ready = True
        else:
            self._build(own)
        result, table = own.result, own.queries
        if self.boxes is not None:
            self.boxes.found = self.boxes.launched = False
            if self.boxes.boxes[0][0].shape[0] != table.cells.shape[0]:
                self.boxes = None
        return result

    def look_ahead(self, particles, wanted):
        if self.boxes is not None:
            self.boxes.launched = False
        if wanted:
            self._boxes(particles).launch()

    def relative_displacements(self, *particles):
        return self._boxes(particles).relative_displacements()

    def _boxes(self, particles):
        held = self.boxes
        if held is None or any(a is not b for a, b in zip(held.particles, particles)):
            self.boxes = CellBoxes(self, *particles)  # only where particles move far enough to ask
        return self.boxes

    def build_against(self, position, prepared):
        static = self._held("static", position, *prepared)
        if not static.ready:
            self._build(static)
        static.ready = False
        return static.result

    def reorder(self, array, order):
        moved = self.backend.empty(array.shape, array.dtype)
        device.gather(array, order, moved)
        return moved

    def audit(self, *given):
        self.audit_before_sort(*given)
        self._taken_audit()()

    def audit_before_sort(self, position, velocity, timestep, neighbours, audited, radius, bounds=None):
        """As `audit`, launched beside the first part of the sorting that follows."""
        given = (position, velocity, timestep, bounds, self.period, neighbours, *audited, position.dtype.type(radius))
        if self.auditor is None or any(a is not b for a, b in zip(self.auditor[0][:6], given)):
            self.auditor = given, partial(count_missed, *given, self.lists["own"].queries.report)
        self.wanted = True

    def _taken_audit(self):
        """The launch of the audit that is wanted, None if none is."""
        wanted, self.wanted = self.wanted, False
        return self.auditor[1] if wanted else None

    @property
    def missed(self):
        """Neighbours that audits had found missing when the list was built last."""
        return self.lists["own"].missed

    def _held(self, name, position, source, table):
        """The list of this name, a new one where its arrays are others."""
        held = self.lists.get(name)
        if held is None or held.position is not position or held.source is not source:
            own = self.lists.get("own")  # built before the one against static particles
            known = own.queries if table is not None and own is not None and own.position is position else None
            held = self.lists[name] = ListOf(self, position, source, table, known)
        return held

    def _build(self, *lists):
        """Build lists in one graph, the first of which finds the cells; the host waits once."""
        if not lists[0].position.shape[0]:
            return
        while True:
            if self.together[0] != lists:
                self.together = lists, device.Recorded(lambda: self._launch(lists))
                self.counted = ()
            self.together[1]()
            lists[-1].mirror.read()
            if self.sorter is not None and not self.sorter.ended():
                continue
            fitting = [held.fits() for held in lists]
            if all(fitting):
                break
            self.together = (), None
        parts = (*self.lists.values(), *(part for part in (self.sorter, self.boxes) if part is not None))
        if parts != self.counted:
            self.counted, self.log.list_bytes = parts, sum(part.nbytes for part in parts)

    def _launch(self, lists):
        lists[0].find_cells()
        device.side_by_side(*(held.launch for held in lists))
