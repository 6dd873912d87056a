"""Cells of particles on the GPU: their keys, and the table of those that are occupied."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import row_kernel
from refsim.neighbours.cell_list import cell_keys
from refsim.neighbours.limits import PARTICLES_PER_CELL

FARTHEST = (1 << 63) - 1  # above every cell's key


@row_kernel
def occupied_cells(i, keys, cells, first, report, run):
    """Keys of the occupied cells and the first particle of each, behind which n and keys beyond all others stand.

    `run` (n,) counts the cells up to each particle. report[0] is the number of cells, also if the
    capacity is exceeded.
    """
    n = run.shape[0]
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

    @property
    def nbytes(self):
        return sum(a.nbytes for a in (self.keys, self.begins, self.run, self.cells, self.first))
