"""Cell sort and neighbour list on the CPU: rows of a compressed list, one pass over the candidates."""

import numpy as np

from refsim.compile import cpu_kernel, prange
from refsim.neighbours.formulas import BITS, cell_coordinate, cell_key, lower_bound
from refsim.neighbours.rows import NeighbourRows

CHUNKS = 64  # fixed, so that the list does not depend on the number of threads


@cpu_kernel
def cell_keys(position, inverse_cell, keys):
    """Cell key of every position; `inverse_cell` [1/m] in float64."""
    for i in prange(keys.shape[0]):
        keys[i] = cell_key(
            cell_coordinate(position[i, 0], inverse_cell),
            cell_coordinate(position[i, 1], inverse_cell),
            cell_coordinate(position[i, 2], inverse_cell),
        )


@cpu_kernel
def build_list(query, query_keys, source, cells, first, radius, dim, exclude_self, index, start, count, needed):
    """Write each query's sources within `radius` [m] into `index`; rows of a chunk follow each other.

    `cells` are the sorted keys of the occupied source cells, `first` (cells + 1) their first source.
    `needed[chunk]` is the room the chunk wanted; where it exceeds the chunk's share nothing is written past it.
    """
    rows = query.shape[0]
    share = index.shape[0] // CHUNKS
    limit = radius * radius
    layers = 1 if dim == 2 else 3
    for chunk in prange(CHUNKS):
        begin = chunk * rows // CHUNKS
        end = (chunk + 1) * rows // CHUNKS
        room = share * (chunk + 1)
        at = share * chunk
        low = np.empty(9, np.int64)
        high = np.empty(9, np.int64)
        ranges = 0
        current = np.int64(-1)
        for i in range(begin, end):
            if query_keys[i] != current:
                current = query_keys[i]
                ranges = 0
                for dz in range(layers):
                    for dy in range(3):
                        middle = current + ((dy - 1) << BITS)
                        if layers == 3:
                            middle += (dz - 1) << (2 * BITS)
                        a = lower_bound(cells, middle - 1)
                        b = a
                        while b < cells.shape[0] and cells[b] <= middle + 1:
                            b += 1
                        if b > a:
                            low[ranges] = first[a]
                            high[ranges] = first[b]
                            ranges += 1
            xi = query[i, 0]
            yi = query[i, 1]
            zi = query[i, 2]
            start[i] = at
            for k in range(ranges):
                for j in range(low[k], high[k]):
                    dx = xi - source[j, 0]
                    dy_ = yi - source[j, 1]
                    dz_ = zi - source[j, 2]
                    if dx * dx + dy_ * dy_ + dz_ * dz_ < limit and not (exclude_self and i == j):
                        if at < room:
                            index[at] = j
                        at += 1
            count[i] = at - start[i]
        needed[chunk] = at - share * chunk


@cpu_kernel
def count_missed(position, count, start, index, rows, radius, missed):
    """Neighbours nearer than `radius` [m] that the list lacks, for each sampled row: all pairs against the list."""
    limit = radius * radius
    for k in prange(rows.shape[0]):
        i = rows[k]
        true = 0
        for j in range(position.shape[0]):
            dx = position[i, 0] - position[j, 0]
            dy = position[i, 1] - position[j, 1]
            dz = position[i, 2] - position[j, 2]
            true += i != j and dx * dx + dy * dy + dz * dz < limit
        listed = 0
        for m in range(start[i], start[i] + count[i]):
            j = index[m]
            dx = position[i, 0] - position[j, 0]
            dy = position[i, 1] - position[j, 1]
            dz = position[i, 2] - position[j, 2]
            listed += dx * dx + dy * dy + dz * dz < limit
        missed[k] = true - listed


def _occupied(keys):
    """(keys of the occupied cells, first particle of each and the end) of sorted particle keys."""
    borders = np.flatnonzero(keys[1:] != keys[:-1]) + 1
    first = np.concatenate(([0], borders, [len(keys)])).astype(np.int64)
    return (keys[first[:-1]], first) if len(keys) else (keys, np.zeros(1, np.int64))


class Search:
    """Host side of the CPU search; lists grow until everything fits."""

    def __init__(self, backend, dim, reach, log):
        self.backend, self.dim, self.reach, self.log = backend, dim, reach, log
        self.storage = {}

    def keys(self, position):
        keys = np.empty(len(position), np.int64)
        cell_keys(position, 1.0 / self.reach, keys)
        return keys

    def order(self, position):
        return np.argsort(self.keys(position), kind="stable")

    def static_set(self, position):
        keys = self.keys(position)
        order = np.argsort(keys, kind="stable")
        position = np.ascontiguousarray(position[order])
        return (position, *_occupied(keys[order])), order, position

    def build(self, position):
        keys = self.keys(position)
        return self._build("own", position, keys, position, *_occupied(keys), exclude_self=True)

    def build_against(self, position, prepared):
        return self._build("static", position, self.keys(position), *prepared, exclude_self=False)

    def _build(self, name, position, keys, source, cells, first, exclude_self):
        n = len(position)
        start, count = np.empty(n, np.int64), np.empty(n, np.int32)
        needed = np.zeros(CHUNKS, np.int64)
        index = self.storage.get(name)
        if index is None or len(index) < CHUNKS:
            index = np.empty(max(CHUNKS, 48 * n if exclude_self else 4 * n), np.int32)
        radius = position.dtype.type(self.reach)
        while True:
            build_list(
                position, keys, source, cells, first, radius, self.dim, exclude_self,
                index, start, count, needed,
            )  # fmt: skip
            if needed.max(initial=0) <= len(index) // CHUNKS:
                break
            index = np.empty(CHUNKS * (int(needed.max()) * 5 // 4 + 16), np.int32)
        self.storage[name] = index
        self.log.list_bytes = sum(a.nbytes for a in self.storage.values()) + 12 * n
        return NeighbourRows(start, count, index), int(count.max(initial=0))

    def missed(self, position, neighbours, rows, radius):
        missed = np.zeros(len(rows), np.int64)
        start, count, index = neighbours
        count_missed(position, count, start, index, rows, position.dtype.type(radius), missed)
        return int(missed.sum())
