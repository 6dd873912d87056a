"""Cell sort on the GPU: the order of particles by cell, found by counting, and arrays put into it."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel, row_kernel
from refsim.neighbours.cell_list import cell_keys
from refsim.neighbours.formulas import BITS
from refsim.neighbours.limits import MOST_NEIGHBOURS


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
        most[t] = report[t]  # which only grows
    cuda.syncthreads()
    if i < keys.shape[0]:
        for c in range(3):
            coordinate = np.int32((keys[i] >> (BITS * c)) & ((1 << BITS) - 1))
            if -coordinate > most[c]:
                cuda.atomic.max(most, c, -coordinate)
            if coordinate > most[c + 3]:
                cuda.atomic.max(most, c + 3, coordinate)
    cuda.syncthreads()
    if t < 6 and most[t] > report[t]:
        cuda.atomic.max(report, t, most[t])


@row_kernel(rows_of="keys")
def count_cells(i, keys, report, count, cell, slot):
    """Each particle's cell, by its number in the box, and which of its particles it is, in whatever order they come.

    report[6] becomes 1 if the cells exceed the capacity of `count`, or a cell has too many particles to be ordered.
    """
    wide, deep = np.int64(report[3]) + report[0] + 1, np.int64(report[4]) + report[1] + 1
    high = np.int64(report[5]) + report[2] + 1
    cell[i] = 0
    slot[i] = 0
    if wide > count.shape[0] or wide * deep > count.shape[0] or wide * deep * high > count.shape[0]:
        report[6] = 1
    else:
        mask = (1 << BITS) - 1
        plane = (keys[i] >> (2 * BITS)) + report[2]
        row = plane * deep + ((keys[i] >> BITS) & mask) + report[1]
        place = row * wide + (keys[i] & mask) + report[0]  # in the order of the keys
        cell[i] = place
        slot[i] = cuda.atomic.add(count, place, 1)
        if slot[i] >= MOST_NEIGHBOURS:
            report[6] = 1


@row_kernel
def fill_buckets(i, cell, slot, count, run, report, bucket):
    """The particles of each cell one after the other, in whatever order they came."""
    if report[6] == 0:
        bucket[run[cell[i]] - count[cell[i]] + slot[i]] = i


@row_kernel
def order_buckets(i, cell, count, run, report, bucket, order):
    """Order of the particles: each behind those of its cell that have smaller numbers."""
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


class Sorter:
    """Puts arrays into cell order, in place, and within a cell by number, by launches that are recorded.

    Counts the particles of each cell in the box of cells around all of them. If the cells exceed the capacity, or a
    cell has more particles than MOST_NEIGHBOURS, the particles keep their order and report[6] is 1.
    """

    def __init__(self, search, position, arrays, sorted_position, behind):
        backend, n = search.backend, position.shape[0]
        self.search, self.position, self.sorted_position = search, position, sorted_position
        self.keys, self.order = backend.empty(n, np.int64), backend.empty(n, np.int64)
        self.rows = device.Rows(arrays, self.order)
        self.cell, self.slot, self.bucket = (backend.empty(n, np.int32) for _ in range(3))
        self.count, self.run = backend.empty(n + 64, np.int32), backend.empty(n + 64, np.int32)
        # Greatest of -x, -y, -z, x, y, z of the cells; whether a capacity is short
        self.report = backend.zeros(7, np.int32)
        self.mirror = device.PinnedCopy(self.report)
        self.add_up = device.RunningSum(self.count, self.run)
        self.all, self.move = device.CudaGraph(self._sort), device.CudaGraph(self._move)
        # Whether the host has yet to see whether counting gave an order, and whether it did the last time
        self.open, self.suffices = False, True
        self.beside, self.behind = None, behind

    def _find_order(self):
        cell_keys(self.position, 1.0 / self.search.reach, self.search.periodic, self.keys, None)
        clear_counts(self.report, self.count)
        box_of_cells(self.keys, self.report)
        count_cells(self.keys, self.report, self.count, self.cell, self.slot)
        self.add_up()
        fill_buckets(self.cell, self.slot, self.count, self.run, self.report, self.bucket)
        order_buckets(self.cell, self.count, self.run, self.report, self.bucket, self.order)
        self.mirror.send()

    def _sort(self):
        device.side_by_side(self._find_order, *(() if self.beside is None else (self.beside,)))
        self._move()

    def _move(self):
        self.rows.launch()
        device.copy(self.position, self.sorted_position)
        if self.behind is not None:
            self.behind()

    def __call__(self, beside):
        """Sort; `beside` is launched before the particles are moved, unless None."""
        if not self.keys.shape[0]:
            return
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
        counted = (self.cell, self.slot, self.bucket, self.count, self.run, self.keys, self.order)
        return sum(array.nbytes for array in counted) + self.rows.nbytes
