"""The force of sorted samples on the nodes: first over those of each cell, then over the cells that reach a node."""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel
from refsim.backends.primitives import wait_for_last
from refsim.backends.tuples import put, scaled
from refsim.sparse_grid.formulas import node_coordinates
from refsim.surface_energy.recorded.cells_cuda import CELLS, occupied_near
from refsim.surface_energy.recorded.fit_cuda import REACHING, load_columns, sum_around
from refsim.surface_energy.recorded.force_cuda import ROWS, pull_row

SUMS = 81  # of a cell: three for each node that its samples reach


@cuda_kernel(threads=CELLS, lanes=ROWS, rows_of="sample_area")
def sum_pulls(sample_position, sample_normal, sample_area, spline_cells, blocks, surface_term, pulls):
    """(4.18*): sum of A_s (I - n n^T) h grad B_k(x_s) of each cell's samples, for each node k that they reach.

    The column of a cell is the place of its first sample among all; the last column holds zeros.
    """
    samples, first = sample_area.shape[0], spline_cells.first
    row, n = cuda.grid(1) // samples, cuda.grid(1) % samples
    space = blocks.neighbour.shape[1] == 27
    real = type(surface_term.cell_size)
    cell = -1
    if row < (ROWS if space else 3):
        if n == 0:
            for k in range(9):
                pulls[9 * row + k, samples] = real(0)
        if n < first[first.shape[0] - 1]:
            cell = spline_cells.cell[spline_cells.point[n]]
    if cell >= 0 and first[cell] == n:
        given, j = (sample_position, sample_normal, sample_area), node_coordinates(blocks, cell)
        pull_row(row, n, n, first[cell + 1], spline_cells.point, j, given, space, surface_term, pulls)


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="blocks.keys", early=True)
def pull_nodes(spline_cells, blocks, pulls, surface_term, node_force):
    """(4.18*): force on the nodes [N], -k sum_s A_s (I - n n^T) grad B_i(x_s)."""
    b = cuda.blockIdx.x
    real = type(surface_term.cell_size)
    near = cuda.shared.array(REACHING, np.int32)
    t = real(0), real(0), real(0)
    if occupied_near(spline_cells.first, blocks, b):
        load_columns(b, None, spline_cells.first, blocks, pulls, near)
        wait_for_last()
        x, y = sum_around(near, blocks, 0, 3, pulls), sum_around(near, blocks, 1, 3, pulls)
        t = x, y, sum_around(near, blocks, 2, 3, pulls)
    elif b == 0:
        wait_for_last()
    put(node_force, CELLS * b + cuda.threadIdx.x, scaled(t, -surface_term.tension / surface_term.cell_size))
