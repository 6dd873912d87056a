"""Cells of particles on the GPU: their keys, and the table of those that are occupied."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.formulas import key_of_place
from refsim.neighbours.limits import PARTICLES_PER_CELL

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
        occupied = run[n - 1]
        capacity = cells.shape[0]
        cell = run[i] - 1
        if cell < capacity and (i == 0 or keys[i] != keys[i - 1]):
            cells[cell] = keys[i]
            first[cell] = i
        if occupied + i < capacity:
            cells[occupied + i] = FARTHEST
        if i == 0:
            report[0] = occupied
            report[3] += 1
            if occupied <= capacity:
                first[occupied] = n


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
