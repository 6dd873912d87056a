"""Blocks and lists of points on the CPU: keys and cells in chunks of points, points sorted by counting."""

import math

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.sparse_grid.formulas import BLOCK, FARTHEST, block_key, find_node_near
from refsim.sparse_grid.tables import PointList, blocks_of, reached

CHUNKS, LEAST_CHUNK = 64, 2048  # of points that one thread takes in their order


@formula
def cell_of_product(x, inverse_cell, shift):
    """`formulas.cell_coordinate`: j = floor(x/h - shift), clamped, whether or not products and sums may be fused.

    The product is bounded before the difference, so that it is rounded first.
    """
    scaled = min(max(float(x) * inverse_cell, -4.0 * FARTHEST), 4.0 * FARTHEST) - shift
    if not scaled > -FARTHEST:
        return -FARTHEST
    return int(math.floor(scaled)) if scaled < FARTHEST else FARTHEST  # noqa: RUF046


@formula
def chunk_of(c, count, chunks):
    """(begin, end) of chunk c (dimensionless) of `count` points."""
    return c * count // chunks, (c + 1) * count // chunks


@kernel(rows_of="held")
def write_runs(c, position, inverse_cell, dim, keys, held):
    """Keys of the blocks of chunk c's points [m], without repetition of the one before; held[c] of them."""
    bits = 2 if dim == 3 else 3
    begin, end = chunk_of(c, position.shape[0], held.shape[0])
    at, last = begin, -1
    for i in range(begin, end):
        jx = cell_of_product(position[i, 0], inverse_cell, 0.0)
        jy = cell_of_product(position[i, 1], inverse_cell, 0.0)
        jz = cell_of_product(position[i, 2], inverse_cell, 0.0) if dim == 3 else 0
        key = block_key(jx, jy, jz, bits)
        if key != last:
            keys[at] = key
            at, last = at + 1, key
    held[c] = at - begin


@kernel(rows_of="chunks")
def write_nodes(c, position, inverse_cell, shift, blocks, chunks, node):
    """Node of the cell in which each point [m] of chunk c stands, -1 where no block holds it."""
    guess = -1
    begin, end = chunk_of(c, position.shape[0], chunks.shape[0])
    for i in range(begin, end):
        jx = cell_of_product(position[i, 0], inverse_cell, shift)
        jy = cell_of_product(position[i, 1], inverse_cell, shift)
        jz = cell_of_product(position[i, 2], inverse_cell, shift) if blocks.neighbour.shape[1] == 27 else 0
        k = find_node_near(blocks, jx, jy, jz, guess)
        node[i] = k
        guess = k >> 6


@kernel(rows_of="held")
def count_by_block(c, node, held):
    """held[c, b] <- points of chunk c in block b."""
    for b in range(held.shape[1]):
        held[c, b] = 0
    begin, end = chunk_of(c, node.shape[0], held.shape[0])
    for i in range(begin, end):
        if node[i] >= 0:
            held[c, node[i] >> 6] += 1


@kernel(rows_of="parts")
def sum_chunks(part, held, total, parts):
    """held[c, b] <- points of block b in the chunks before c; the points of all. A part is 64 blocks, so that few
    threads write to the same lines of memory."""
    begin, end = 64 * part, min(64 * part + 64, total.shape[0])
    for b in range(begin, end):
        total[b] = 0
    for c in range(held.shape[0]):
        for b in range(begin, end):
            count = held[c, b]
            held[c, b] = total[b]
            total[b] += count


@kernel(rows_of="held")
def fill_blocks(c, node, first, held, point):
    """The points of each block by their numbers; `held` says how many stand before those of chunk c."""
    begin, end = chunk_of(c, node.shape[0], held.shape[0])
    for i in range(begin, end):
        if node[i] >= 0:
            b = node[i] >> 6
            point[first[b] + held[c, b]] = i
            held[c, b] += 1


@kernel(rows_of="total")
def sort_block(b, node, block_first, by_block, total, first, point):
    """The points of each cell of block b by their numbers."""
    low, begin, end = 64 * b, block_first[b], block_first[b + 1]
    for c in range(low, low + 64):
        first[c] = 0
    for k in range(begin, end):
        first[node[by_block[k]]] += 1
    before = begin
    for c in range(low, low + 64):
        count = first[c]
        first[c] = before
        before += count
    for k in range(begin, end):
        i = by_block[k]
        point[first[node[i]]] = i
        first[node[i]] += 1  # is in the end the first of the next cell
    for c in range(low + 63, low, -1):
        first[c] = first[c - 1]
    first[low] = begin


def chunks_for(points):
    """Number of chunks of so many points."""
    return min(max(points // LEAST_CHUNK, 1), CHUNKS)


def points_by_block(node, blocks):
    """(first of each of so many blocks, points) by block, int32; those of a block by their numbers."""
    held, total = np.empty((chunks_for(len(node)), blocks), np.int32), np.empty(blocks, np.int32)
    count_by_block(node, held)
    sum_chunks(held, total, np.empty(-(-blocks // 64), np.uint8))
    first = np.zeros(blocks + 1, np.int32)
    np.cumsum(total, out=first[1:])
    point = np.empty(first[-1], np.int32)
    fill_blocks(node, first, held, point)
    return first, point


def points_by_cell(node, blocks):
    """The points of each cell of so many blocks; `node` (n,) int32 is the cell of each, -1 for none."""
    block_first, by_block = points_by_block(node, blocks)
    first, point = np.empty(BLOCK * blocks + 1, np.int32), np.empty(len(by_block), np.int32)
    sort_block(node, block_first, by_block, block_first[1:], first, point)
    first[-1] = len(point)
    return PointList(first, point, node)


class BlockSearch:
    """Host side; `inverse_cell` [1/m] in float64."""

    def __init__(self, dim, inverse_cell):
        self.dim, self.inverse_cell = dim, inverse_cell

    def cover(self, position, below, above):
        count = len(position)
        keys, held = np.empty(count, np.int64), np.empty(chunks_for(count), np.int64)
        write_runs(position, self.inverse_cell, self.dim, keys, held)
        begin = np.arange(len(held)) * count // len(held)
        runs = [keys[b : b + h] for b, h in zip(begin, held, strict=True)]
        bits = 2 if self.dim == 3 else 3
        occupied = reached(np.concatenate(runs), self.dim, -below >> bits, ((1 << bits) - 1 + above) >> bits)
        return blocks_of(occupied, self.dim)

    def cell_of(self, position, blocks, shift):
        node, chunks = np.empty(len(position), np.int32), np.empty(chunks_for(len(position)), np.uint8)
        write_nodes(position, self.inverse_cell, float(shift), blocks, chunks, node)
        return node

    def by_cell(self, position, blocks, shift):
        return points_by_cell(self.cell_of(position, blocks, shift), len(blocks.keys))
