"""Cell sort and neighbour list on the CPU: rows of a compressed list, one pass over the candidates."""

import math

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.fast.bits import WORD, lowest, marked
from refsim.neighbours import formulas
from refsim.neighbours.limits import NEIGHBOUR_CAPACITY, WALL_CAPACITY
from refsim.neighbours.rows import NeighbourRows

CHUNKS = 64  # fixed, so that the list does not depend on the number of threads
ROWS_AROUND = 18  # of cells around one, at most


@kernel(rows_of="keys")
def cell_keys(i, position, inverse_cell, periodic, keys, begins):
    """Cell key of a position; `inverse_cell` [1/m] in float64, `periodic` the cells of a periodic box or None.

    begins[i] = 1 if particle i is the first of its cell, for particles that stand in cell order; None otherwise.
    """
    key = formulas.key_of_place(position[i, 0], position[i, 1], position[i, 2], inverse_cell, periodic)
    keys[i] = key
    if begins is not None:
        j = max(i - 1, 0)
        before = formulas.key_of_place(position[j, 0], position[j, 1], position[j, 2], inverse_cell, periodic)
        begins[i] = i == 0 or key != before


@formula
def mark_near(x, y, z, limit, candidates, period, near, mark):
    """mark[m] = whether column m of `near` lies within the root of `limit` [m^2] of (x, y, z); vectorised."""
    for m in range(candidates):
        dx = x - near[0, m]
        dy = y - near[1, m]
        dz = z - near[2, m]
        dx, dy, dz = formulas.to_nearest_image(dx, dy, dz, period)
        mark[m] = dx * dx + dy * dy + dz * dz < limit


@formula
def append_marked(mark, candidates, names, index, at):
    """Append the names of the marked candidates to `index`; the next free place."""
    for first in range(np.uint64(0), np.uint64(candidates), np.uint64(WORD)):
        marks = marked(mark, first)
        while marks != np.uint64(0):
            index[at] = names[first + lowest(marks)]
            at += np.uint64(1)
            marks &= marks - np.uint64(1)
    return at


@kernel
def build_list(chunk, queries, sources, radius, dim, exclude_self, period, periodic, listed, needed):
    """Write the sources within `radius` [m] of each query of a chunk into the list's entries, row after row.

    queries  positions and keys
    sources  positions, sorted keys of the occupied cells, and the first source of each (cells + 1)
    listed   the list, and for each chunk positions, numbers and marks of the sources around a query, and rows of cells
    With a `period` distances are those to the nearest image, and `periodic` are the cells of its box.
    `needed[chunk]` is the capacity of the list and of the buffers that the chunk needs; nothing is written beyond.
    """
    query, query_keys = queries
    source, cells, first = sources
    start, count, index, near, names, mark, low_cell = listed
    near, names, mark, low_cell = near[chunk], names[chunk], mark[chunk], low_cell[chunk]
    rows = query.shape[0]
    share = index.shape[0] // CHUNKS
    limit = radius * radius
    layers = 1 if dim == 2 else 3
    begin = chunk * rows // CHUNKS
    end = (chunk + 1) * rows // CHUNKS
    capacity = share * (chunk + 1)
    at = share * chunk
    rows_around = 3 * layers
    if periodic is not None:
        rows_around = 6 * layers
    current = np.int64(-1)
    candidates = 0
    widest = 0
    kept = np.int64(0)
    for i in range(begin, end):
        if query_keys[i] != current:
            # Queries mostly come in cell order, so each of the nine rows of cells is walked forward.
            backward = query_keys[i] < current or current < 0
            current = query_keys[i]
            candidates = 0
            for k in range(rows_around):
                least, most = formulas.row_around(current, k, layers, periodic)
                if periodic is not None:
                    backward = True  # rows come from both sides of the box
                a = formulas.lower_bound(cells, least) if backward else low_cell[k]
                while a < cells.shape[0] and cells[a] < least:
                    a += 1
                low_cell[k] = a
                b = a
                while b < cells.shape[0] and cells[b] <= most:
                    b += 1
                low = first[a]
                size = first[b] - low
                widest = max(widest, candidates + size)
                if widest > names.shape[0]:  # the host makes wider buffers and begins anew
                    candidates += size
                    continue
                if exclude_self and least <= current and current <= most:
                    kept = candidates - low  # this row of cells holds the query itself
                for m in range(size):
                    names[candidates + m] = low + m
                    near[0, candidates + m] = source[low + m, 0]
                    near[1, candidates + m] = source[low + m, 1]
                    near[2, candidates + m] = source[low + m, 2]
                candidates += size
        if widest > names.shape[0]:
            continue
        mark_near(query[i, 0], query[i, 1], query[i, 2], limit, candidates, period, near, mark)
        for m in range(candidates, WORD * ((candidates + WORD - 1) // WORD)):
            mark[m] = 0
        if exclude_self:
            mark[kept + i] = 0
        start[i] = at
        if at + candidates <= capacity:
            at = np.int64(append_marked(mark, candidates, names, index, np.uint64(at)))
        else:
            for m in range(candidates):
                if mark[m]:
                    if at < capacity:
                        index[at] = names[m]
                    at += 1
        count[i] = at - start[i]
    needed[chunk, 0], needed[chunk, 1] = at - share * chunk, widest


@kernel(rows_of="order")
def reorder_rows(i, values, order, moved):
    """moved[i, :] = values[order[i], :]."""
    for c in range(values.shape[1]):
        moved[i, c] = values[order[i], c]


@formula
def near_before(i, j, position, velocity, shift, drift, bounds, period, limit):
    """Whether j lay within the root of `limit` [m^2] of i before the latest step, if that is known of both."""
    near = (formulas.squared_distance_before(i, j, position, velocity, shift, drift, period) < limit) & (i != j)
    if near:
        near = formulas.known_before(i, j, position, bounds)
    return near


@kernel(rows_of="rows")
def count_missed(k, position, velocity, shift, drift, bounds, period, listed, rows, missed):
    """Neighbours nearer than the radius [m] of `listed` that this list lacks, for a sampled row, by all pairs.

    The list was last used at position - drift * velocity - shift, before the latest step; where that is not known,
    because a plane of `bounds` stopped the particle, its pairs are left out.
    """
    start, count, index, radius = listed
    i, limit, found = rows[k], radius * radius, 0
    for j in range(position.shape[0]):
        found += near_before(i, j, position, velocity, shift, drift, bounds, period, limit)
    for at in range(start[i], start[i] + count[i]):
        found -= near_before(i, index[at], position, velocity, shift, drift, bounds, period, limit)
    missed[k] = found


@kernel
def block_boxes(b, position, build_position, first, order, begin, low, high):
    """Box [low, high] (blocks, 3) [m] of the displacements of a block's particles since the list was built.

    The cells of block b are order[begin[b] : begin[b + 1]]; `first` is the first particle of each cell.
    """
    for c in range(3):
        low[b, c] = np.inf
        high[b, c] = -np.inf
    for k in range(begin[b], begin[b + 1]):
        for i in range(first[order[k]], first[order[k] + 1]):
            for c in range(3):
                displacement = position[i, c] - build_position[i, c]
                low[b, c] = min(low[b, c], displacement)
                high[b, c] = max(high[b, c], displacement)


@kernel
def block_displacements(b, blocks, low, high, layers, displacements):
    """Largest squared relative displacement [m^2] of particles of a block (key) and of one that touches it, or it."""
    largest = formulas.squared_between(low, high, b, b, 0)
    for k in range(3 * layers):  # rows of x; the half of them that lies before this one is seen from there
        least, most = formulas.row_around(blocks[b], k, layers, None)
        a = formulas.lower_bound(blocks, least)
        while a < b and blocks[a] <= most:
            largest = max(largest, formulas.squared_between(low, high, a, b, 0))
            a += 1
    displacements[b] = largest


def _occupied(keys):
    """(keys of the occupied cells, first particle of each and the end) of sorted particle keys."""
    borders = np.flatnonzero(keys[1:] != keys[:-1]) + 1
    first = np.concatenate(([0], borders, [len(keys)])).astype(np.int64)
    return (keys[first[:-1]], first) if len(keys) else (keys, np.zeros(1, np.int64))


def buffers(dtype, width):
    """What `build_list` puts together in each chunk, for so many sources around a query."""
    width = WORD * math.ceil(width / WORD)
    shapes = ((3, width), dtype), ((width,), np.int32), ((width,), np.uint8), ((ROWS_AROUND,), np.int64)
    return tuple(np.empty((CHUNKS, *shape), kind) for shape, kind in shapes)


class CellSearch:
    """Host side of the CPU search; lists grow until everything fits."""

    looks_ahead, steps_ahead = False, 0

    def __init__(self, backend, dim, reach, log, period=None):
        self.backend, self.dim, self.reach, self.listed, self.log = backend, dim, reach, reach, log
        self.period, self.periodic = period, formulas.periodic_cells(period, reach)
        self.storage, self.width = {}, 512  # sources around a query that the buffers hold
        self.cells = self.blocks = None
        self.missed = 0  # neighbours that audits have found missing

    def keys(self, position):
        keys = np.empty(len(position), np.int64)
        cell_keys(position, 1.0 / self.reach, self.periodic, keys, None)
        return keys

    def order(self, position):
        return np.argsort(self.keys(position), kind="stable")

    def sort(self, position, arrays, sorted_position):
        order = self.order(position)
        moved = [self.reorder(array, order) for array in arrays]
        sorted_position[...] = next(new for old, new in zip(arrays, moved) if old is position)
        return moved

    def static_set(self, position):
        keys = self.keys(position)
        order = np.argsort(keys, kind="stable")
        position = np.ascontiguousarray(position[order])
        return (position, *_occupied(keys[order])), order, position

    def build(self, position):
        keys = self.keys(position)
        self.cells, self.blocks = _occupied(keys), None
        return self._build("own", position, keys, position, *self.cells, exclude_self=True)

    def relative_displacements(self, position, build_position, velocity, timestep):
        """Bounds [m] of two particles of touching blocks, which others are two cells apart from, and of any two."""
        cells, first = self.cells
        if self.blocks is None:  # only where the particles move far enough to ask
            keys = formulas.block_key(cells)
            order = np.argsort(keys, kind="stable")
            self.blocks = order, *_occupied(keys[order])
        order, keys, begin = self.blocks
        low, high = np.empty((2, len(keys), 3), position.dtype)
        displacements = np.empty(len(keys), position.dtype)
        block_boxes(position, build_position, first, order, begin, low, high)
        block_displacements(keys, low, high, 1 if self.dim == 2 else 3, displacements)
        anywhere = ((high.max(0) - low.min(0)) ** 2).sum()
        return ((math.sqrt(float(displacements.max())), math.sqrt(float(anywhere))),)

    def build_against(self, position, prepared):
        return self._build("static", position, self.keys(position), *prepared, exclude_self=False)

    def build_around(self, position, prepared, name):
        around = prepared[0]
        return self._build(name, around, self.keys(around), position, *self.cells, exclude_self=False)

    def _build(self, name, position, keys, source, cells, first, exclude_self):
        n = len(position)
        start, count = np.empty(n, np.int64), np.empty(n, np.int32)
        needed = np.zeros((CHUNKS, 2), np.int64)
        index = self.storage.get(name)
        if index is None or len(index) < CHUNKS:
            capacity = WALL_CAPACITY if name == "static" else NEIGHBOUR_CAPACITY
            index = np.empty(max(CHUNKS, capacity * n), np.uint32)
        radius = position.dtype.type(self.listed)
        queries, sources, around = (position, keys), (source, cells, first), (self.period, self.periodic)
        while True:
            listed = start, count, index, *buffers(position.dtype, self.width)
            build_list(queries, sources, radius, self.dim, exclude_self, *around, listed, needed)
            capacity, width = map(int, needed.max(0))
            if width > self.width:
                self.width = 2 * width
            elif capacity > len(index) // CHUNKS:
                index = np.empty(CHUNKS * (capacity * 5 // 4 + 16), np.uint32)
            else:
                break
        self.storage[name] = index
        self.log.list_bytes = sum(a.nbytes for a in self.storage.values()) + 12 * n
        return NeighbourRows(start, count, index), int(count.max(initial=0))

    def audit(self, position, velocity, timestep, neighbours, audited, radius, bounds=None, shift=None):
        rows = self.log.rebuilds * 7919 % audited.share + audited.share * np.arange(audited.number)
        missed = np.zeros(len(rows), np.int64)
        real = position.dtype.type
        drift = real(timestep[1])
        given = position, velocity, shift, drift, bounds, self.period
        count_missed(*given, (*neighbours, real(radius)), rows, missed)
        self.missed += int(missed.sum())

    def reorder(self, array, order):
        moved = np.empty_like(array)
        columns = (len(array), array.size // max(len(array), 1))
        reorder_rows(array.reshape(columns), order, moved.reshape(columns))
        return moved
