"""Blocks and lists of points on the CPU: sorting and searching by NumPy."""

import itertools

import numpy as np

from refsim.neighbours.formulas import BITS, OFFSET
from refsim.sparse_grid.formulas import BLOCK, FARTHEST
from refsim.sparse_grid.tables import Blocks, PointList


class BlockSearch:
    """Host side; `inverse_cell` [1/m] in float64."""

    def __init__(self, dim, inverse_cell):
        self.dim, self.inverse_cell = dim, inverse_cell
        self.bits = 2 if dim == 3 else 3
        self.width = 1 << self.bits

    def cell_coordinates(self, position, shift=0.0):
        """(n, 3) int64; 0 along z in the plane."""
        with np.errstate(invalid="ignore", over="ignore"):
            scaled = position[:, : self.dim].astype(float) * self.inverse_cell - shift
        scaled = np.where(scaled > -FARTHEST, np.minimum(scaled, FARTHEST), -FARTHEST)
        coordinates = np.zeros((len(position), 3), np.int64)
        np.floor(scaled, out=scaled)
        coordinates[:, : self.dim] = scaled
        return coordinates

    def keys(self, block):
        """Sortable keys of block coordinates (..., 3)."""
        return ((block[..., 2] + OFFSET) << (2 * BITS)) | ((block[..., 1] + OFFSET) << BITS) | (block[..., 0] + OFFSET)

    def block_of(self, coordinates):
        block = coordinates >> self.bits
        if self.dim == 2:
            block[..., 2] = coordinates[..., 2]
        return block

    def cover(self, position, below, above):
        return self._blocks(self.cell_coordinates(position), below, above)

    def holding(self, coordinates):
        return self._blocks(np.asarray(coordinates, np.int64), 1, 1)

    def _blocks(self, coordinates, below, above):
        occupied = self.keys(self.block_of(coordinates))
        occupied = np.unique(occupied[np.append(True, occupied[1:] != occupied[:-1])[: len(occupied)]])
        axis = range((-below) >> self.bits, ((self.width - 1 + above) >> self.bits) + 1)
        steps = self.keys(np.array(list(itertools.product(*(axis if c < self.dim else (0,) for c in range(3))))))
        keys = np.unique((occupied[:, None] + (steps - self.keys(np.zeros(3, np.int64)))[None, :]).ravel())
        steps = np.array(
            [w[::-1] for w in itertools.product(*((-1, 0, 1) if c < self.dim else (0,) for c in (2, 1, 0)))]
        )
        wanted = keys[:, None] + (self.keys(steps) - self.keys(np.zeros(3, np.int64)))[None, :]
        place = np.searchsorted(keys, wanted)
        place[place == len(keys)] = 0
        found = keys[place] == wanted if len(keys) else np.zeros(wanted.shape, bool)
        return Blocks(keys, np.where(found, place, -1).astype(np.int32))

    def node_of(self, coordinates, blocks):
        """Number of the node (n,) int64 with integer coordinates (n, 3), -1 where no block holds it."""
        key = self.keys(self.block_of(coordinates))
        if not len(blocks.keys):
            return np.full(len(key), -1)
        place = np.minimum(np.searchsorted(blocks.keys, key), len(blocks.keys) - 1)
        rest = coordinates & (self.width - 1)
        local = (rest[:, 1] << self.bits) | rest[:, 0]
        if self.dim == 3:
            local |= rest[:, 2] << 4
        return np.where(blocks.keys[place] == key, place * BLOCK + local, -1)

    def cell_of(self, position, blocks, shift):
        return self.node_of(self.cell_coordinates(position, shift), blocks).astype(np.int32)

    def by_cell(self, position, blocks, shift):
        count = BLOCK * len(blocks.keys)
        node = self.node_of(self.cell_coordinates(position, shift), blocks)
        order = np.argsort(node, kind="stable")
        outside = np.count_nonzero(node < 0)
        first = np.zeros(count + 1, np.int32)
        np.cumsum(np.bincount(node[node >= 0], minlength=count), out=first[1:])
        return PointList(first, order[outside:].astype(np.int32), node.astype(np.int32))


def neighbours_along(blocks, axis):
    """Number of the next node along an axis of every node (nodes,) int64, -1 where there is none."""
    bits = 2 if blocks.neighbour.shape[1] == 27 else 3
    local = np.arange(BLOCK)
    place = [local & ((1 << bits) - 1), (local >> bits) & ((1 << bits) - 1), local >> (2 * bits)]
    place[axis] = place[axis] + 1
    beyond = place[axis] >> bits
    place[axis] = place[axis] & ((1 << bits) - 1)
    block = blocks.neighbour[:, blocks.neighbour.shape[1] // 2 + beyond * 3**axis].astype(np.int64)
    node = block * BLOCK + ((place[2] << (2 * bits)) | (place[1] << bits) | place[0])[None, :]
    return np.where(block >= 0, node, -1).ravel()
