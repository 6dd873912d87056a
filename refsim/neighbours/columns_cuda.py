"""Neighbour list on the GPU: columns, so that neighbouring threads read neighbouring words."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, row_kernel
from refsim.backends.primitives import four_of, set_four, sum_before_lane
from refsim.backends.runtime import simulated
from refsim.core.errors import RunStopped
from refsim.neighbours.cell_table_cuda import CellTable
from refsim.neighbours.formulas import lower_bound, row_around, to_nearest_image
from refsim.neighbours.limits import MOST_NEIGHBOURS, with_margin
from refsim.neighbours.rows import NeighbourColumns, cuda_lane

# Threads that share a column if there are few particles: with one thread each the device would wait for memory. One in
# the simulator, which has no ballots.
LANES, FEW = 1 if simulated() else 4, 500_000
# While it is built: if some have had more than MANY neighbours, if there are few particles, and else
BUILDERS, MANY = (1, 1, 1) if simulated() else (4, 2, 1), 64
WORD, AT_ONCE = 32, 8  # sources that a thread looks at before it writes, and of which it reads so many together


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
            least, most = row_around(query_cells[i], piece, low.shape[1] // (3 * pieces), periodic)
            a = lower_bound(cells, least)
            b = a
            while b < cells.shape[0] and cells[b] <= most:
                b += 1
            low[i, piece] = first[a]
            high[i, piece] = first[b]


@row_kernel(rows_of="source")
def pack_places(i, source, placed):
    """placed[i] = (x, y, z, 0) of the source [m], which a thread reads at once."""
    set_four(placed, i, source[i, 0], source[i, 1], source[i, 2], placed.dtype.type(0))


@cuda_kernel(rows_of="query", lanes="listed")
def build_list(query, run, low, high, placed, radius, exclude_self, period, report, listed):
    """Write each query's sources within `radius` [m] into its column of the list, up to its capacity.

    run[i] - 1 is the row of `low` and `high` that holds query i's ranges. The list's `count` says how many there are,
    also if the capacity is exceeded; report[1] is the largest count so far. Each lane notes which of at most WORD
    sources in a row are near, as bits, and then writes these: most sources are not.
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
        total = np.int32(0)
        for k in range(low.shape[1]):
            begin, end = low[c, k], high[c, k]  # read once: for the compiler, `entries` might be the same memory
            while begin < end:
                share = min(WORD, (end - begin + lanes - 1) // lanes)
                first = begin + share * lane
                near = near_sources(placed, first, min(first + share, end), itself, x, y, z, limit, period)
                before, together = sum_before_lane(cuda.popc(near), lane, lanes)
                at = total + before
                total += together
                while near != 0 and at < capacity:
                    listed.entries[at * n + i] = first + cuda.ffs(near) - 1
                    near = np.uint32(near & (near - np.uint32(1)))
                    at += 1
                begin += share * lanes
        if lane == 0:
            listed.count[i] = total
            if total > report[1]:
                cuda.atomic.max(report, 1, total)


@cuda_formula
def near_sources(placed, first, end, own, x, y, z, limit, period):
    """A word whose bit k says whether source first + k, before `end` and not `own`, is nearer than the root of `limit`.

    `placed` is read up to AT_ONCE - 1 rows beyond `end`: what is read together is on its way together.
    """
    many, near = max(end - first, 0), np.uint32(0)
    for k in range(0, many, AT_ONCE):
        some = np.uint32(0)
        for bit in range(AT_ONCE):
            xj, yj, zj, _ = four_of(placed, first + k + bit)
            dx, dy, dz = to_nearest_image(x - xj, y - yj, z - zj, period)
            if dx * dx + dy * dy + dz * dz < limit:
                some |= np.uint32(1 << bit)
        near |= np.uint32(some << np.uint32(k))
    if first <= own < end:
        near &= ~np.uint32(1 << (own - first))
    return np.uint32(near & np.uint32(np.int64((1 << WORD) - 1) >> (WORD - many)))


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
        self.placed = self.backend.zeros((source.shape[0] + AT_ONCE - 1, 4), position.dtype)
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
        builders = BUILDERS[0 if self.most > MANY else 1 if self.position.shape[0] < FEW else 2]
        build_list(
            self.position, queries.run, self.low, self.high, self.placed, radius, exclude_self, search.period,
            self.report, self.listed._replace(lanes=(np.int32(0),) * builders),
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
            columns = with_margin(self.most)
            self.listed = self.listed._replace(entries=self.backend.empty(1, np.uint32))  # frees the former
            free = device.free_bytes()
            if 4 * columns * n > free:
                raise RunStopped(
                    "out_of_memory",
                    f"The neighbour list needs {columns} columns of {n} particles, {4e-9 * columns * n:.3g} GB, and the"
                    f" device has {1e-9 * free:.3g} GB left; take fewer particles or a smaller support radius.",
                )
            self.listed = self.listed._replace(entries=self.backend.empty(columns * n, np.uint32))
            return False
        return True

    @property
    def nbytes(self):
        arrays = (self.low, self.high, self.listed.count, self.listed.entries, self.placed)
        return (self.queries.nbytes if self.known is None else 0) + sum(a.nbytes for a in arrays)
