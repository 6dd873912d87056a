"""Neighbour list on the GPU: columns, so that neighbouring threads read neighbouring words."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.primitives import four_of, set_four, sum_before_lane
from refsim.backends.runtime import simulated
from refsim.core.errors import RunStopped
from refsim.neighbours.cell_table_cuda import CellTable
from refsim.neighbours.formulas import BITS, lower_bound, periodic_row, to_nearest_image
from refsim.neighbours.limits import MOST_NEIGHBOURS, with_margin
from refsim.neighbours.rows import NeighbourColumns, cuda_lane

# Threads that share a column if there are few particles: with one thread each the device would wait for memory. One in
# the simulator, which has no ballots.
LANES, FEW = 1 if simulated() else 4, 500_000


@cuda_kernel(lanes=9)
def cell_ranges(cells, first, query_cells, query_report, periodic, low, high):
    """Sources in the cells around each query cell: three cells in a row of x are one range [low, high).

    `cells` are the sorted keys of the occupied source cells, `first` their first source; `low` and `high` have a
    column for each row of cells around a cell (3 in 2D, 9 in 3D), and each a thread. With the cells of a `periodic` box
    they have twice as many columns, for pieces of rows on the other side of the box.
    """
    i, k = cuda.grid(1) // 9, cuda.grid(1) % 9
    pieces = 1 if periodic is None else 2
    if i < high.shape[0] and i < query_report[0] and pieces * k < low.shape[1]:
        for piece in range(pieces * k, pieces * (k + 1)):
            if periodic is not None:
                least, most = periodic_row(query_cells[i], piece, low.shape[1] // 6, periodic)
            else:
                middle = query_cells[i] + ((k % 3 - 1) << BITS)
                if low.shape[1] == 9:
                    middle += (k // 3 - 1) << (2 * BITS)
                least, most = middle - 1, middle + 1
            a = lower_bound(cells, least)
            b = a
            while b < cells.shape[0] and cells[b] <= most:
                b += 1
            low[i, piece] = first[a]
            high[i, piece] = first[b]


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
        itself = i if exclude_self != 0 else -1
        total = 0
        for k in range(low.shape[1]):
            end = high[c, k]  # read once: for the compiler, `entries` might be the same memory
            for begin in range(low[c, k], end, 4 * lanes):
                j = begin + 4 * lane
                first = near_source(placed, j, end, itself, x, y, z, limit, period)
                second = near_source(placed, j + 1, end, itself, x, y, z, limit, period)
                third = near_source(placed, j + 2, end, itself, x, y, z, limit, period)
                fourth = near_source(placed, j + 3, end, itself, x, y, z, limit, period)
                before, together = sum_before_lane(first + second + third + fourth, lane, lanes)
                at = total + before
                write_found(i, n, j, first, at, capacity, listed)
                write_found(i, n, j + 1, second, at + first, capacity, listed)
                write_found(i, n, j + 2, third, at + first + second, capacity, listed)
                write_found(i, n, j + 3, fourth, at + first + second + third, capacity, listed)
                total += together
        if lane == 0:
            listed.count[i] = total
            if total > report[1]:
                cuda.atomic.max(report, 1, total)


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
        self.mirror = device.PinnedCopy(self.report)
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
        radius = self.position.dtype.type(search.listed)
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
        arrays = (self.low, self.high, self.listed.count, self.listed.entries, self.placed)
        return (self.queries.nbytes if self.known is None else 0) + sum(a.nbytes for a in arrays)
