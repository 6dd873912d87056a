"""Blocks and lists of points on a CUDA device; CuPy sorts and searches."""

import itertools

import numpy as np

from refsim import device
from refsim.compile import cuda, cuda_kernel
from refsim.neighbours.formulas import BITS, OFFSET
from refsim.sparse_grid import Blocks, PointList
from refsim.sparse_grid.formulas import BLOCK, cell_coordinate, find_node


@cuda_kernel
def block_keys(position, inverse_cell, dim, keys):
    """Key of the block in which each position [m] stands."""
    i = cuda.grid(1)
    if i < keys.shape[0]:
        bits = 2 if dim == 3 else 3
        bx = cell_coordinate(position[i, 0], inverse_cell, 0.0) >> bits
        by = cell_coordinate(position[i, 1], inverse_cell, 0.0) >> bits
        bz = cell_coordinate(position[i, 2], inverse_cell, 0.0) >> 2 if dim == 3 else 0
        keys[i] = ((bz + OFFSET) << (2 * BITS)) | ((by + OFFSET) << BITS) | (bx + OFFSET)


@cuda_kernel
def point_nodes(position, inverse_cell, shift, blocks, node):
    """Node of the cell in which each point stands, -1 where no block holds it."""
    i = cuda.grid(1)
    if i < node.shape[0]:
        jx = cell_coordinate(position[i, 0], inverse_cell, shift)
        jy = cell_coordinate(position[i, 1], inverse_cell, shift)
        jz = cell_coordinate(position[i, 2], inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
        node[i] = find_node(blocks, jx, jy, jz)


class Search:
    """Host side; `inverse_cell` [1/m] in float64."""

    def __init__(self, dim, inverse_cell):
        self.dim, self.inverse_cell = dim, inverse_cell
        self.bits = 2 if dim == 3 else 3
        self.width = 1 << self.bits

    def cover(self, position, below, above):
        keys = device.empty(position.shape[0], np.int64)
        block_keys(position, self.inverse_cell, self.dim, keys)
        return self._blocks(device.seen(keys), below, above)

    def holding(self, coordinates):
        xp = device.library()
        block = xp.asarray(device.seen(coordinates)).astype(np.int64)
        block = xp.stack([block[:, c] >> self.bits if c < self.dim else 0 * block[:, c] for c in range(3)])
        keys = ((block[2] + OFFSET) << (2 * BITS)) | ((block[1] + OFFSET) << BITS) | (block[0] + OFFSET)
        return self._blocks(keys, 1, 1)

    def _steps(self, axis):
        steps = itertools.product(*(axis if c < self.dim else (0,) for c in (2, 1, 0)))
        return np.array([(z << (2 * BITS)) + (y << BITS) + x for z, y, x in steps], np.int64)

    def _blocks(self, occupied, below, above):
        xp = device.library()
        begins = xp.ones(len(occupied), dtype=bool)
        begins[1:] = occupied[1:] != occupied[:-1]
        occupied = xp.unique(occupied[begins])
        axis = range((-below) >> self.bits, ((self.width - 1 + above) >> self.bits) + 1)
        keys = xp.unique((occupied[:, None] + xp.asarray(self._steps(axis))[None, :]).ravel())
        wanted = keys[:, None] + xp.asarray(self._steps((-1, 0, 1)))[None, :]
        if not len(keys):
            return Blocks(device.wrapped(keys), device.empty(wanted.shape, np.int32))
        place = xp.minimum(xp.searchsorted(keys, wanted.ravel()).reshape(wanted.shape), len(keys) - 1)
        neighbour = xp.where(keys[place] == wanted, place, -1).astype(np.int32)
        return Blocks(device.wrapped(keys), device.wrapped(xp.ascontiguousarray(neighbour)))

    def by_cell(self, position, blocks, shift):
        xp = device.library()
        count = BLOCK * blocks.keys.shape[0]
        if not position.shape[0] or not count:
            nowhere = device.wrapped(xp.full(position.shape[0], -1, np.int32))
            return PointList(device.wrapped(xp.zeros(count + 1, np.int32)), device.empty(0, np.int32), nowhere)
        node = device.empty(position.shape[0], np.int32)
        point_nodes(position, self.inverse_cell, float(shift), blocks, node)
        cell, node = node, device.seen(node)
        order = xp.argsort(node, kind="stable").astype(np.int32)
        held = xp.bincount(node + 1, minlength=count + 1)
        first = xp.cumsum(held).astype(np.int32) - held[0].astype(np.int32)
        return PointList(device.wrapped(first), device.wrapped(xp.ascontiguousarray(order[int(held[0]) :])), cell)
