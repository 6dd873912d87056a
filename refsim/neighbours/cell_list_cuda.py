"""Host side of the neighbour search on the GPU, and the audit of its lists."""

from functools import partial

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.backends.runtime import simulated
from refsim.neighbours.cell_boxes_cuda import LOOK_AHEAD, CellBoxes
from refsim.neighbours.cell_list import cell_keys
from refsim.neighbours.cell_order_cuda import Sorter
from refsim.neighbours.cell_table_cuda import CellTable
from refsim.neighbours.columns_cuda import ListOf, pack_places
from refsim.neighbours.formulas import known_before, periodic_cells, squared_distance_before

ROWS_TOGETHER = 1 if simulated() else 2  # threads that audit a particle


@cuda_kernel(rows_of="position", lanes=ROWS_TOGETHER)
def count_missed(position, velocity, shift, timestep, bounds, period, neighbours, audited, radius, report):
    """Add to report[2] the neighbours nearer than `radius` [m] that sampled rows of the list lack.

    `audited` rows are one out of each share, taken by the lanes by turns; which one follows from the number of lists
    built, report[3]. The list was last used at position - timestep[1] * velocity - shift, before the latest step;
    where that is not known, because a plane of `bounds` stopped the particle, its pairs are left out.
    """
    j, lane = cuda.grid(1) // ROWS_TOGETHER, cuda.grid(1) % ROWS_TOGETHER
    if j < position.shape[0]:
        limit, (share, number) = radius * radius, audited
        first_row = report[3] * 7919 % share
        drift = timestep[1]
        for k in range(lane, number, ROWS_TOGETHER):
            i = first_row + k * share
            if j < neighbours.count[i]:  # thread j also looks at the row's j-th entry
                other = neighbours.entries[j * position.shape[0] + i]
                if known_before(i, other, position, bounds):  # noqa: SIM102
                    if squared_distance_before(i, other, position, velocity, shift, drift, period) < limit:
                        cuda.atomic.add(report, 2, -1)
            if i == j or not known_before(i, j, position, bounds):
                continue
            if squared_distance_before(i, j, position, velocity, shift, drift, period) < limit:
                cuda.atomic.add(report, 2, 1)


class CellSearch:
    """Host side of the GPU search; buffers belong to the arrays they were made for: launches are recorded once."""

    looks_ahead, steps_ahead = True, LOOK_AHEAD

    def __init__(self, backend, dim, reach, log, period=None):
        self.backend, self.dim, self.reach, self.log = backend, dim, reach, log
        self.period, self.periodic = period, periodic_cells(period, reach)
        self.lists = {}
        self.sorter = self.boxes = self.auditor = None
        self.together = (), {}  # lists that are built in one graph, and the graph by how far they reach
        self.counted = ()  # whose bytes the log has
        self.wanted = False  # whether an audit is to be launched

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
        cells = int(self.backend.host(table.report)[0])
        if cells > table.cells.shape[0]:
            table.set_capacity(cells)
            table.fill()
        return (moved, table), self.backend.host(order), moved

    def build(self, position):
        if audit := self._taken_audit():
            audit()
        fluid = self._held("own", position, position, None)
        static = self.lists.get("static")
        if static is not None and static.known is fluid.queries:  # built with it: it is wanted next
            self._build(fluid, static)
            static.ready = True
        else:
            self._build(fluid)
        if self.boxes is not None:
            self.boxes.near_known = self.boxes.launched = False
            if self.boxes.boxes[0][0].shape[0] != fluid.queries.cells.shape[0]:
                self.boxes = None
        return fluid.listed, fluid.most

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
        return static.listed, static.most

    def build_around(self, position, prepared, name):
        around, table = prepared
        fluid, held = self.lists["own"], self.lists.get(name)
        if held is None or held.source is not position or held.table is not fluid.queries:
            held = self.lists[name] = ListOf(self, around, position, fluid.queries, table)
        while True:
            pack_places(position, held.placed)
            held.launch()
            held.mirror.read()
            if held.fits():
                return held.listed, held.most

    def reorder(self, array, order):
        moved = self.backend.empty(array.shape, array.dtype)
        device.gather(array, order, moved)
        return moved

    def audit(self, position, velocity, timestep, neighbours, audited, radius, bounds=None, shift=None):
        """Launched beside the first part of the sorting that follows, or before a build without one."""
        arrays = position, velocity, timestep, bounds, neighbours, *(shift or ())
        if self.auditor is None or any(a is not b for a, b in zip(self.auditor[0], arrays)):
            given = position, velocity, shift, timestep, bounds, self.period, neighbours
            given = *given, tuple(audited), position.dtype.type(radius), self.lists["own"].queries.report
            self.auditor = arrays, partial(count_missed, *given)
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
            fluid = self.lists.get("own")  # built before the one against static particles
            known = fluid.queries if table is not None and fluid is not None and fluid.position is position else None
            held = self.lists[name] = ListOf(self, position, source, table, known)
        return held

    def _build(self, *lists):
        """Build lists in one graph, the first of which finds the cells; the host waits once."""
        if not lists[0].position.shape[0]:
            return
        while True:
            if self.together[0] != lists:
                self.together = lists, {}
                self.counted = ()
            self.together[1].setdefault(self.listed, device.CudaGraph(lambda: self._launch(lists)))()
            lists[-1].mirror.read()
            if self.sorter is not None and not self.sorter.ended():
                continue
            fitting = [held.fits() for held in lists]
            if all(fitting):
                break
            self.together = (), {}
        parts = (*self.lists.values(), *(part for part in (self.sorter, self.boxes) if part is not None))
        if parts != self.counted:
            self.counted, self.log.list_bytes = parts, sum(part.nbytes for part in parts)

    def _launch(self, lists):
        lists[0].find_cells()
        device.side_by_side(*(held.launch for held in lists))
