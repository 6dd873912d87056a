"""Cell sort and neighbour list on the GPU: columns, so that neighbouring threads read neighbouring words."""

import numpy as np

from refsim import device
from refsim.compile import cuda, cuda_kernel, formula
from refsim.errors import RunStopped
from refsim.neighbours import MOST_NEIGHBOURS
from refsim.neighbours.formulas import BITS, at_bounds, cell_coordinate, cell_key, lower_bound
from refsim.neighbours.rows import NeighbourColumns, cuda_row


@cuda_kernel
def cell_keys(position, inverse_cell, keys):
    """Cell key of every position; `inverse_cell` [1/m] in float64."""
    i = cuda.grid(1)
    if i < keys.shape[0]:
        keys[i] = cell_key(
            cell_coordinate(position[i, 0], inverse_cell),
            cell_coordinate(position[i, 1], inverse_cell),
            cell_coordinate(position[i, 2], inverse_cell),
        )


@cuda_kernel
def cell_ranges(cells, first, low, high, query_cells):
    """Sources in the cells around each query cell: three cells in a row of x are one range [low, high).

    `cells` are the sorted keys of the occupied source cells, `first` (cells + 1) their first source; `low` and
    `high` have a column for each row of cells around a cell (3 in 2D, 9 in 3D).
    """
    i = cuda.grid(1)
    if i < query_cells.shape[0]:
        for k in range(low.shape[1]):
            middle = query_cells[i] + ((k % 3 - 1) << BITS)
            if low.shape[1] == 9:
                middle += (k // 3 - 1) << (2 * BITS)
            a = lower_bound(cells, middle - 1)
            b = a
            while b < cells.shape[0] and cells[b] <= middle + 1:
                b += 1
            low[i, k] = first[a]
            high[i, k] = first[b]


@cuda_kernel
def build_list(query, cell, low, high, source, radius, exclude_self, index, count):
    """Write each query's sources within `radius` [m] into its column of `index`, as many as there is room for.

    `cell` is the row of `low` and `high` that holds the query's ranges. `count` says how many there are, also
    where the room was too small.
    """
    i = cuda.grid(1)
    n = count.shape[0]
    if i < n:
        room = index.shape[0] // n
        limit = radius * radius
        c = cell[i]
        xi = query[i, 0]
        yi = query[i, 1]
        zi = query[i, 2]
        found = 0
        for k in range(low.shape[1]):
            for j in range(low[c, k], high[c, k]):
                dx = xi - source[j, 0]
                dy = yi - source[j, 1]
                dz = zi - source[j, 2]
                if dx * dx + dy * dy + dz * dz < limit and (exclude_self == 0 or i != j):
                    if found < room:
                        index[found * n + i] = j
                    found += 1
        count[i] = found


@formula
def squared_distance_before(i, j, position, velocity, drift):
    """|x_i - x_j|^2 [m^2] a time `drift` [s] ago."""
    squared = type(drift)(0)
    for c in range(3):
        way = (position[i, c] - drift * velocity[i, c]) - (position[j, c] - drift * velocity[j, c])
        squared += way * way
    return squared


@formula
def known_before(i, j, position, bounds):
    """Whether both particles' places before the latest step follow from their velocities."""
    if bounds is not None:
        return not (at_bounds(i, position, bounds) or at_bounds(j, position, bounds))
    return True


@cuda_kernel(rows_of="position")
def count_missed(position, velocity, drift, bounds, neighbours, rows, radius, missed):
    """Neighbours nearer than `radius` [m] that the list lacks, for each sampled row (never more than particles).

    The list was last used at position - drift * velocity, before the latest step; where that is not known, because a
    plane of `bounds` stopped the particle, its pairs are left out.
    """
    j = cuda.grid(1)
    if j < position.shape[0]:
        limit = radius * radius
        for k in range(rows.shape[0]):
            i = rows[k]
            if i == j or not known_before(i, j, position, bounds):
                continue
            if squared_distance_before(i, j, position, velocity, drift) < limit:
                cuda.atomic.add(missed, k, 1)
        if j < rows.shape[0]:
            i = rows[j]
            first, stride, listed = cuda_row(neighbours, i)
            for k in range(listed):
                other = neighbours.entries[first + k * stride]
                if not known_before(i, other, position, bounds):
                    continue
                if squared_distance_before(i, other, position, velocity, drift) < limit:
                    cuda.atomic.add(missed, j, -1)


class Search:
    """Host side of the GPU search; lists grow until everything fits."""

    def __init__(self, backend, dim, reach, log):
        self.backend, self.dim, self.reach, self.log = backend, dim, reach, log
        self.storage = {}

    def keys(self, position):
        keys = self._buffer("keys", position.shape[:1], np.int64)
        cell_keys(position, 1.0 / self.reach, keys)
        return keys

    def order(self, position):
        return device.stable_order(self.keys(position))

    def static_set(self, position):
        position = self.backend.asarray(position)
        order = self.order(position)
        moved = self.reorder(position, order)
        cells, first, _ = device.runs(self.keys(moved))
        return (moved, cells, first), self.backend.host(order), moved

    def build(self, position):
        cells, first, cell = device.runs(self.keys(position))
        return self._build("own", position, cells, cell, position, cells, first, exclude_self=True)

    def build_against(self, position, prepared):
        query_cells, _, cell = device.runs(self.keys(position))
        return self._build("static", position, query_cells, cell, *prepared, exclude_self=False)

    def reorder(self, array, order):
        moved = self.backend.empty(array.shape, array.dtype)
        device.gather(array, order, moved)
        return moved

    def missed(self, position, velocity, drift, neighbours, rows, radius, bounds=None):
        missed = self.backend.zeros(len(rows), np.int32)
        real = position.dtype.type
        rows = self.backend.asarray(rows)
        count_missed(position, velocity, real(drift), bounds, neighbours, rows, real(radius), missed)
        return int(self.backend.host(missed).sum())

    def _build(self, name, position, query_cells, cell, source, cells, first, exclude_self):
        n = position.shape[0]
        low, high = self._range_buffers(query_cells.shape[0])
        cell_ranges(cells, first, low, high, query_cells)
        count = self._buffer(name + " count", (n,), np.int32)
        index = self.storage.get(name)
        if index is None:
            index = self.backend.empty(1, np.int32)  # the first pass counts only
        radius = position.dtype.type(self.reach)
        while True:
            build_list(position, cell, low, high, source, radius, int(exclude_self), index, count)
            most = device.largest(count)
            if most * n <= index.shape[0] or most > MOST_NEIGHBOURS:
                break
            index = self._grown(name, n, most)
        self.storage[name] = index
        self.log.list_bytes = sum(a.nbytes for a in self.storage.values())
        return NeighbourColumns(count, index), most

    def _buffer(self, name, shape, dtype):
        buffer = self.storage.get(name)
        if buffer is None or buffer.shape != shape:
            buffer = self.storage[name] = self.backend.empty(shape, dtype)
        return buffer

    def _range_buffers(self, cells):
        """Two arrays with a row for each query cell, and some to spare: their number changes with every list."""
        held = self.storage.get("low")
        rows = held.shape[0] if held is not None and held.shape[0] >= cells else cells + cells // 8
        shape = (rows, 3 if self.dim == 2 else 9)
        return self._buffer("low", shape, np.int32), self._buffer("high", shape, np.int32)

    def _grown(self, name, n, most):
        """Room for `most` neighbours of each of `n` particles and some more; stops the run where memory ends."""
        columns = most + most // 8 + 4
        self.storage.pop(name, None)
        free = device.free_bytes()
        if 4 * columns * n > free:
            raise RunStopped(
                "out_of_memory",
                f"The neighbour list needs {columns} columns of {n} particles, {4e-9 * columns * n:.3g} GB, and the"
                f" device has {1e-9 * free:.3g} GB left; take fewer particles or a smaller support radius.",
            )
        return self.backend.empty(columns * n, np.int32)
