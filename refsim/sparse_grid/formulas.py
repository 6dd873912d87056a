"""Index arithmetic of the sparse grid: coordinates, keys of blocks, steps from node to node.

Nodes stand at x_j = h j with integer coordinates j, from -2^20 to 2^20 along each axis; what is beyond is clamped.
A block holds 64 nodes, 4 x 4 x 4 in space and 8 x 8 in the plane; node 64 b + l is the l-th of block b, x fastest.
Cell j has its lowest corner at node j, so that cells and nodes share their numbers.
"""

import math

import numpy as np

from refsim.backends.compile import formula
from refsim.neighbours.formulas import BITS, OFFSET, cell_key, lower_bound

BLOCK = 64
FARTHEST = 1 << 20
COORDINATE = (1 << BITS) - 1


@formula
def cell_coordinate(x, inverse_cell, shift):
    """Integer j = floor(x/h - shift) of the cell in which x [m] stands, clamped; NaN goes to the lowest.

    `inverse_cell` 1/h [1/m] is float64 whatever x is, so that cells far from the origin are distinguished.
    """
    scaled = float(x) * inverse_cell - shift
    if not scaled > -FARTHEST:
        return -FARTHEST
    if scaled >= FARTHEST:
        return FARTHEST
    return int(math.floor(scaled))  # noqa: RUF046  (in CUDA floor gives a float)


@formula
def block_bits(blocks):
    """Bits (dimensionless) that number a block's nodes along an axis: = 2 in space, 3 in the plane."""
    return 2 if blocks.neighbour.shape[1] == 27 else 3


@formula
def block_key(jx, jy, jz, bits):
    """Key = 2^42 b_z + 2^21 b_y + b_x (dimensionless) of the block with node j; in the plane jz is not divided."""
    bz = jz >> 2 if bits == 2 else jz
    return cell_key((jx >> bits) + OFFSET, (jy >> bits) + OFFSET, bz + OFFSET)


@formula
def place_in_block(jx, jy, jz, bits):
    """Number (dimensionless) of the node x = h j among those of its block."""
    rest = (1 << bits) - 1
    local = ((jy & rest) << bits) | (jx & rest)
    return local | ((jz & rest) << 4) if bits == 2 else local


@formula
def find_node(blocks, jx, jy, jz):
    """Number i (dimensionless) of the node x = h j with integer coordinates j, -1 where no block holds it."""
    return find_node_near(blocks, jx, jy, jz, -1)


@formula
def find_node_near(blocks, jx, jy, jz, guess):
    """Number i (dimensionless) of the node x = h j, -1 where no block holds it.

    Block `guess` and those beside it are looked at first. A guess may be of an earlier table with more blocks, or -1.
    """
    bits = block_bits(blocks)
    b = find_block(blocks, block_key(jx, jy, jz, bits), guess)
    return b * BLOCK + place_in_block(jx, jy, jz, bits) if b >= 0 else -1


@formula
def find_block(blocks, key, guess):
    """Number b (dimensionless) of the block with keys[b] = key, -1 without one; `guess` and those beside it first."""
    if 0 <= guess < blocks.keys.shape[0]:
        held = blocks.keys[guess]
        if held == key:
            return np.int64(guess)
        dx, dy = (key & COORDINATE) - (held & COORDINATE), ((key >> BITS) & COORDINATE) - ((held >> BITS) & COORDINATE)
        dz = (key >> (2 * BITS)) - (held >> (2 * BITS))
        if max(abs(dx), max(abs(dy), abs(dz))) <= 1:
            return np.int64(blocks.neighbour[guess, blocks.neighbour.shape[1] // 2 + dx + 3 * dy + 9 * dz])
    b = np.int64(lower_bound(blocks.keys, key))
    return b if b < blocks.keys.shape[0] and blocks.keys[b] == key else np.int64(-1)


@formula
def node_coordinates(blocks, node):
    """Integer coordinates j = x/h of a node, dimensionless."""
    key, local = blocks.keys[np.uint32(node >> 6)], node & 63
    bx, by, bz = (key & COORDINATE) - OFFSET, ((key >> BITS) & COORDINATE) - OFFSET, (key >> (2 * BITS)) - OFFSET
    if block_bits(blocks) == 2:
        return (bx << 2) + (local & 3), (by << 2) + ((local >> 2) & 3), (bz << 2) + (local >> 4)
    return (bx << 3) + (local & 7), (by << 3) + (local >> 3), bz


@formula
def number(i):
    """i >= 0, dimensionless, unsigned: an index that may count from an array's end costs six instructions more."""
    return np.int64(np.uint32(i))


@formula
def step_node(blocks, node, dx, dy, dz):
    """Number (dimensionless) of the node j + (dx, dy, dz), |d| <= a block's width, -1 where no block holds it."""
    local = np.int32(node & 63)
    if blocks.neighbour.shape[1] == 27:
        x, y, z = np.int32((local & 3) + dx), np.int32(((local >> 2) & 3) + dy), np.int32((local >> 4) + dz)
        way = np.uint32(13 + (x >> 2) + 3 * (y >> 2) + 9 * (z >> 2))
        place = np.int32((x & 3) | ((y & 3) << 2) | ((z & 3) << 4))
    else:
        x, y = np.int32((local & 7) + dx), np.int32((local >> 3) + dy)
        way, place = np.uint32(4 + (x >> 3) + 3 * (y >> 3)), np.int32((x & 7) | ((y & 7) << 3))
    b = blocks.neighbour[np.uint32(node >> 6), way]  # an index that may be negative takes six instructions more
    return b * BLOCK + place if b >= 0 else -1
