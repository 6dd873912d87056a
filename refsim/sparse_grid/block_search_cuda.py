"""Blocks and lists of points on a CUDA device; a counting sort makes the lists."""

from collections import namedtuple

import numpy as np

from refsim.backends import device
from refsim.backends.compile import SIMULATED_THREADS, cuda, row_kernel
from refsim.backends.runtime import simulated
from refsim.sparse_grid.block_table_cuda import enter_keys, make_table
from refsim.sparse_grid.formulas import BLOCK, block_key, cell_coordinate, find_node
from refsim.sparse_grid.formulas import number as number
from refsim.sparse_grid.tables import PointList, key_steps

SUMMING = SIMULATED_THREADS if simulated() else 1024


@row_kernel
def block_keys(i, position, inverse_cell, dim, keys):
    """Key of the block in which each position [m] stands."""
    bits = 2 if dim == 3 else 3
    jx = cell_coordinate(position[i, 0], inverse_cell, 0.0)
    jy = cell_coordinate(position[i, 1], inverse_cell, 0.0)
    jz = cell_coordinate(position[i, 2], inverse_cell, 0.0) if dim == 3 else 0
    keys[i] = block_key(jx, jy, jz, bits)


@row_kernel
def point_nodes(i, position, inverse_cell, shift, blocks, node):
    """Node of the cell in which each point stands, -1 where no block holds it."""
    jx = cell_coordinate(position[i, 0], inverse_cell, shift)
    jy = cell_coordinate(position[i, 1], inverse_cell, shift)
    jz = cell_coordinate(position[i, 2], inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
    node[i] = find_node(blocks, jx, jy, jz)


# Points are sorted by counting, without the host. The order in which they reach a counter differs from run to run, so
# that their numbers are sorted within each cell afterwards.


@row_kernel(rows_of="node")
def count_points(i, node, held, place):
    """How many points of its cell were counted before each."""
    if node[i] >= 0:
        place[i] = cuda.atomic.add(held, node[i], 1)


@row_kernel(rows_of="cell")
def fill_cells(i, cell, place, first, unsorted):
    """The particles of each cell, in any order."""
    if cell[i] >= 0:
        unsorted[first[cell[i]] + place[i]] = i


@row_kernel(rows_of="cell")
def sort_cells(i, cell, first, unsorted, point):
    """The particles of each cell by their numbers."""
    if cell[i] >= 0:
        begin, end = number(first[cell[i]]), number(first[cell[i] + 1])
        at = begin
        while begin < end:
            if unsorted[begin] < i:
                at += 1
            begin += 1
        point[at] = i


# Points by bin, as `PointList`, and scratch memory in which they are made without the host, int32: the points held of
# each bin, the place of each point in its bin, and the points of each bin in any order
Lists = namedtuple("Lists", "first point held place unsorted totals")


def lists_of(empty, bins, points):
    """Lists of so many points; empty(part, shape, dtype) gives the arrays."""
    shapes = bins + 1, points, bins, points, points, device.tiles(bins)
    return Lists(*(empty(part, shape, np.int32) for part, shape in zip(Lists._fields, shapes, strict=True)))


@row_kernel(rows_of="held")
def begin_lists(i, first, held):
    """Counts and the first place are 0."""
    held[i] = 0
    if i == 0:
        first[0] = 0


def fill_lists(cell, lists):
    """The points of each bin by their numbers; `held` and `place` are counted before. It can be recorded."""
    device.RunningSum(lists.held, lists.first[1:], lists.totals)()
    fill_cells(cell, lists.place, lists.first, lists.unsorted)
    sort_cells(cell, lists.first, lists.unsorted, lists.point)


def sorted_points(cell, nodes):
    """(first, point) of the points of each of `nodes` cells; the end of `point` is unused where points have no cell."""
    lists = lists_of(lambda _, *kind: device.empty(*kind), nodes, cell.shape[0])
    if not cell.shape[0] or not nodes:
        device.fill(lists.first, 0)
        return lists.first, lists.point
    begin_lists(lists.first, lists.held)
    count_points(cell, lists.held, lists.place)
    fill_lists(cell, lists)
    return lists.first, lists.point


class BlockSearch:
    """Host side; `inverse_cell` [1/m] in float64."""

    def __init__(self, dim, inverse_cell):
        self.dim, self.inverse_cell = dim, inverse_cell
        self.bits = 2 if dim == 3 else 3
        self.width = 1 << self.bits

    def cover(self, position, below, above):
        keys = device.empty(position.shape[0], np.int64)
        block_keys(position, self.inverse_cell, self.dim, keys)
        axis = self._axis(below, above)
        entries = [lambda *table: enter_keys(*table, keys)]
        return make_table(keys.shape[0], entries, self.dim, axis[0], axis[-1])[0]

    def with_margin(self, position, below, above, margin):
        """(blocks that reach `margin` nodes farther than `cover`, whether all in reach of each exist (blocks,) uint8).

        They suffice until a particle has moved as far.
        """
        blocks = self.cover(position, below + margin, above + margin)
        xp, made = device.cupy_or_numpy(), device.as_cupy(blocks.keys)
        if not len(made):
            return blocks, device.empty(0, np.uint8)
        wanted = made[:, None] + xp.asarray(key_steps(self.dim, self._axis(below, above)))[None, :]
        place = xp.minimum(xp.searchsorted(made, wanted.ravel()).reshape(wanted.shape), len(made) - 1)
        return blocks, device.as_numba((made[place] == wanted).all(1).astype(np.uint8))

    def _axis(self, below, above):
        """Blocks along an axis in reach of a point's, from `below` nodes under to `above` over its cell."""
        return range((-below) >> self.bits, ((self.width - 1 + above) >> self.bits) + 1)

    def by_cell(self, position, blocks, shift):
        cell = self.cell_of(position, blocks, shift)
        return PointList(*sorted_points(cell, BLOCK * blocks.keys.shape[0]), cell)

    def cell_of(self, position, blocks, shift):
        node = device.empty(position.shape[0], np.int32)
        point_nodes(position, self.inverse_cell, float(shift), blocks, node)
        return node
