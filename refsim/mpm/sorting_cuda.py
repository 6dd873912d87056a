"""Cells of points, keys of their blocks, and points by cell, on a GPU; with `sort_particles` without the host."""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel, formula, row_kernel
from refsim.mpm.groups import SETS, Bins, Owned, Samples
from refsim.mpm.kernels import cell_of, embed_samples, point_key
from refsim.mpm.limits import DEEP, LOST, OUTSIDE
from refsim.sparse_grid import block_table_cuda
from refsim.sparse_grid.block_search_cuda import begin_lists, count_points, fill_lists, lists_of, number, sorted_points
from refsim.sparse_grid.block_table_cuda import EMPTY, enter_point


@row_kernel
def write_cells(i, position, inverse_cell, blocks, complete, counts, cell):
    """Cell of each point: number of its base node; -1 outside all blocks. counts = (missing, lost)."""
    node = cell_of(i, position, inverse_cell, blocks, complete, -1)
    if node < 0:
        cuda.atomic.add(counts, OUTSIDE - node, 1)
    cell[i] = max(node, OUTSIDE)


@row_kernel(rows_of="position")
def enter_points(i, position, inverse_cell, bits, table, listed, counts):
    """The different keys of the points' blocks."""
    key = point_key(i, position, inverse_cell, bits)
    before = point_key(i - 1, position, inverse_cell, bits) if i > 0 else EMPTY
    enter_point(key, before, table, listed, counts)


def block_keys(position, inverse_cell, dim):
    """The points as `make_table` takes them: their number, and a call that enters the keys of their blocks."""
    bits = 2 if dim == 3 else 3
    return position.shape[0], lambda *table: enter_points(position, inverse_cell, bits, *table)


def find_cells(position, inverse_cell, blocks, complete, cell):
    """Write the points' cells; (points outside all blocks, points too far away or NaN)."""
    counts = device.as_numba(device.cupy_or_numpy().zeros(2, np.int32))
    write_cells(position, inverse_cell, blocks, complete, counts, cell)
    missing, lost = device.as_cupy(counts).tolist()
    return missing, lost


@formula
def has_reach(neighbour, b):
    """Whether all blocks exist that the particles of block b (x in b, dimensionless) reach."""
    ways = neighbour.shape[1]
    whole = True
    for way in range(ways // 2, ways):
        if way % 3 > 0 and way // 3 % 3 > 0 and neighbour[b, way] < 0:
            whole = False
    return whole


@row_kernel
def mark_complete(b, neighbour, complete):
    """1 where all blocks that a block's particles reach exist, DEEP where so do all around it and theirs, else 0."""
    found = 0
    if has_reach(neighbour, b):
        found = DEEP
        for way in range(neighbour.shape[1]):
            other = neighbour[b, way]
            if other < 0 or not has_reach(neighbour, other):
                found = 1
    complete[b] = found


def make_table(points, dim, low, high):
    """(blocks in reach of points as `block_keys` gives them, whether each is complete, points without a key)."""
    counts, entries = zip(*points, strict=True)
    blocks, lost = block_table_cuda.make_table(sum(counts), entries, dim, low, high)
    complete = device.empty(blocks.keys.shape[0], np.uint8)
    mark_complete(blocks.neighbour, complete)
    return blocks, complete, lost


def sorted_bins(cell, blocks):
    """Points by cell."""
    return sorted_points(cell, 64 * blocks)


# Sorting without the host, so that a CUDA graph can hold it: all blocks exist.


@cuda_kernel
def count_cells(position, inverse_cell, blocks, complete, held, noted, place, cell):
    """Cell of each point, and how many of its cell were counted before it; -1 outside all blocks.

    The search begins in the block of the present value of `cell`, which may be any number. `noted` counts the points
    that are not deep in the blocks (see DEEP), and those too far away or NaN.
    """
    i = number(cuda.grid(1))
    if i < cell.shape[0]:
        node = cell_of(i, position, inverse_cell, blocks, complete, cell[i] >> 6)
        if node >= 0:
            place[i] = cuda.atomic.add(held, number(node), 1)
        if noted is not None:
            if node == LOST:
                cuda.atomic.add(noted, 1, 1)
            elif node < 0 or complete[number(node >> 6)] != DEEP:
                cuda.atomic.add(noted, 0, 1)
        cell[i] = max(node, OUTSIDE)


@cuda_kernel(rows_of="point")
def count_gaps(point, noted):
    """The last of `noted` counts particles that are not in memory directly after their predecessor in the lists."""
    i = cuda.grid(1)
    if i + 1 < point.shape[0] and point[i + 1] != point[i] + 1:
        cuda.atomic.add(noted, 2, 1)


def bins_of(name, grid, points):
    """Bins for so many points of a set, whose arrays are then there."""
    lists = lists_of(grid.lists.called(name), grid.nodes, points)
    return Bins(lists.first, lists.point)


def sort_points(name, position, grid, cell, noted=None):
    """Cells and bins of a set of points, whose blocks exist; those that are NaN are in none."""
    lists = lists_of(grid.lists.called(name), grid.nodes, position.shape[0])
    begin_lists(lists.first, lists.held)
    if noted is not None:
        device.fill(noted, 0)
    count_cells(position, grid.inverse_cell, grid.blocks, grid.complete, lists.held, noted, lists.place, cell)
    fill_lists(cell, lists)
    grid.bins[name] = Bins(lists.first, lists.point)


def order(position, grid, cell):
    """The particles, cell by cell; how many are out of order is noted."""
    sort_points(SETS[0], position, grid, cell, grid.noted.array)
    point = grid.bins[SETS[0]].point
    count_gaps(point, grid.noted.array)
    return point


def cells(position, carrier_position, surface_sample, grid, cell):
    """Cell of every particle, with the blocks and bins of all point sets brought up to date."""
    sets = position, carrier_position, surface_sample
    if grid.noted is not None:
        for name, points in grid.held(sets, cell).items():
            sort_points(name, points, grid, grid.cells[name], grid.noted.array if points is position else None)
        return
    grid.locate(sets, cell, find_cells, block_keys, sorted_bins, make_table)


def embed(
    position, surface_sample, sample_owner, background, scratch, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner (-1: none, NaN at the end), shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    lists = lists_of(scratch.called("owners"), position.shape[0], sample_owner.shape[0])
    begin_lists(lists.first, lists.held)
    count_points(sample_owner, lists.held, lists.place)
    fill_lists(sample_owner, lists)
    device.fill(carrier_position, math.nan)
    samples, carriers = Samples(surface_sample, lists.point, lists.first), Owned(carrier_position, carrier_owner)
    embed_samples(position, samples, background.cell_size, carriers, carrier_first, cluster_share, inverse_spread)
