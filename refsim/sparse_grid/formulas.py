"""Index arithmetic of the sparse grid: coordinates, keys of blocks, steps from node to node.

Nodes stand at x_j = h j with integer coordinates j, from -2^20 to 2^20 along each axis; what is beyond is clamped.
A block holds 64 nodes, 4 x 4 x 4 in space and 8 x 8 in the plane; node 64 b + l is the l-th of block b, x fastest.
Cell j has its lowest corner at node j, so that cells and nodes share their numbers.
"""

import math

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
    """Number i (dimensionless) of the node x = h j, -1 where no block holds it; block `guess` is looked at first.

    A guess may be of an earlier table with more blocks, or -1.
    """
    bits = block_bits(blocks)
    key = block_key(jx, jy, jz, bits)
    b = guess
    if guess < 0 or guess >= blocks.keys.shape[0] or blocks.keys[guess] != key:
        b = lower_bound(blocks.keys, key)
        if b == blocks.keys.shape[0] or blocks.keys[b] != key:
            return -1
    return b * BLOCK + place_in_block(jx, jy, jz, bits)


@formula
def node_coordinates(blocks, node):
    """Integer coordinates j = x/h of a node, dimensionless."""
    bits = block_bits(blocks)
    rest = (1 << bits) - 1
    key = blocks.keys[node >> 6]
    local = node & 63
    jx = (((key & COORDINATE) - OFFSET) << bits) + (local & rest)
    jy = ((((key >> BITS) & COORDINATE) - OFFSET) << bits) + ((local >> bits) & rest)
    jz = (key >> (2 * BITS)) - OFFSET
    if bits == 2:
        jz = (jz << 2) + (local >> 4)
    return jx, jy, jz


@formula
def step_node(blocks, node, dx, dy, dz):
    """Number (dimensionless) of the node j + (dx, dy, dz), |d| <= a block's width, -1 where no block holds it."""
    bits = block_bits(blocks)
    rest = (1 << bits) - 1
    local = node & 63
    x = (local & rest) + dx
    y = ((local >> bits) & rest) + dy
    z = (local >> (2 * bits)) + dz
    direction = blocks.neighbour.shape[1] // 2 + (x >> bits) + 3 * (y >> bits)
    if bits == 2:
        direction += 9 * (z >> 2)
    b = blocks.neighbour[node >> 6, direction]
    if b < 0:
        return -1
    return b * BLOCK + (((z & rest) << (2 * bits)) | ((y & rest) << bits) | (x & rest))
