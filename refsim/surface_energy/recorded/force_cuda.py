"""The force of the samples on the nodes of the same blocks."""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel
from refsim.backends.primitives import behind_last, wait_for_last
from refsim.backends.tuples import put, scaled, three
from refsim.sparse_grid.block_search_cuda import number
from refsim.sparse_grid.formulas import node_coordinates
from refsim.surface_energy import formulas
from refsim.surface_energy.recorded.cells_cuda import CELLS, MADE, SAMPLED, SAMPLES
from refsim.surface_energy.recorded.fit_cuda import REACHING, load_columns, place_in_row, reached_from, sum_around

ROWS = 9  # of nodes along x that the samples of a cell reach, a thread to each; 3 in the plane


@cuda_kernel(rows_of="fit_cell", early=True)
def sort_samples(fit_cell, bins, unsorted, counts, point):
    """The samples of each cell by their numbers."""
    s = cuda.grid(1)
    if behind_last(s < counts[MADE] and fit_cell[s] >= 0):
        point[place_in_row(s, fit_cell[s], *bins, unsorted)] = s


@cuda_formula
def pull_row(row, column, begin, end, point, j, samples, space, surface_term, pulls):
    """A column of `pulls`: sum of A_s (I - n n^T) h grad B_k(x_s) of the samples from `begin` to `end` of a cell.

    The nodes k are those of a row in their reach, j that of the cell; samples: positions [m], normals and areas.
    """
    real = type(surface_term.cell_size)
    position, normal, area = samples
    ky, kz = row % 3, row // 3
    total = cuda.local.array(9, pulls.dtype)
    for k in range(9):
        total[k] = real(0)
    for at in range(begin, end):
        s = number(point[at])
        fx = formulas.grid_offset(position[s, 0], j[0], surface_term)
        fy = formulas.grid_offset(position[s, 1], j[1], surface_term)
        wz, sz = real(1), real(0)
        if space:
            fz = formulas.grid_offset(position[s, 2], j[2], surface_term)
            wz, sz = formulas.spline_weight(fz, kz), formulas.spline_slope(fz, kz)
        n, own = three(normal, s), area[s]
        wy, sy = formulas.spline_weight(fy, ky), formulas.spline_slope(fy, ky)
        for kx in range(3):
            wx, sx = formulas.spline_weight(fx, kx), formulas.spline_slope(fx, kx)
            ux, uy, uz = formulas.tangential(n, (sx * wy * wz, wx * sy * wz, wx * wy * sz))
            total[3 * kx] += own * ux
            total[3 * kx + 1] += own * uy
            total[3 * kx + 2] += own * uz
    for k in range(9):
        pulls[9 * row + k, column] = total[k]


@cuda_kernel(threads=CELLS, rows_of="rows", early=True)
def sum_pulls(samples, bins, point, filled, counts, blocks, surface_term, pulls, rows):
    """(4.18*): sum of A_s (I - n n^T) h grad B_k(x_s) of each cell's samples, for each node k that they reach."""
    most = pulls.shape[1] - 1
    row, n = cuda.grid(1) // most, cuda.grid(1) % most
    space = blocks.neighbour.shape[1] == 27
    if row < (ROWS if space else 3) and n < counts[SAMPLED]:
        cell = filled[n]
        j = node_coordinates(blocks, cell)
        first, held = bins
        begin, end = first[cell], first[cell] + held[cell]
        wait_for_last()
        given = samples.sample_position, samples.sample_normal, samples.sample_area
        pull_row(row, n, begin, end, point, j, given, space, surface_term, pulls)
    elif cuda.blockIdx.x == 0:
        wait_for_last()


@cuda_kernel(block_for_each_row=True, threads=CELLS, rows_of="total", early=True)
def pull_nodes(held_in_block, rank, blocks, pulls, surface_term, node_force, counts, total):
    """(4.18*): force on the nodes [N], -k sum_s A_s (I - n n^T) grad B_i(x_s); samples may then be numbered again."""
    b = cuda.blockIdx.x
    i = CELLS * b + cuda.threadIdx.x
    if b == 0:
        wait_for_last()
        if i == 0:
            counts[SAMPLED], counts[SAMPLES] = 0, 0
    real = type(surface_term.cell_size)
    near = cuda.shared.array(REACHING, np.int32)
    t = real(0), real(0), real(0)
    if reached_from(held_in_block, blocks, b):
        load_columns(b, rank, None, blocks, pulls, near)
        wait_for_last()
        x, y = sum_around(near, blocks, 0, 3, pulls), sum_around(near, blocks, 1, 3, pulls)
        t = x, y, sum_around(near, blocks, 2, 3, pulls)
    put(node_force, i, scaled(t, -surface_term.tension / surface_term.cell_size))
