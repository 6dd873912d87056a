"""The table of blocks on a CUDA device: different keys by hashing, then sorted; the host waits once.

Keys are entered in tables of a power of two of places. If a table is too full, it is made larger and filled again.
"""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula, row_kernel
from refsim.neighbours.formulas import BITS, lower_bound
from refsim.sparse_grid.formulas import COORDINATE
from refsim.sparse_grid.tables import Blocks

EMPTY = -1  # no key
TRIES = 64  # places of a table that are looked at for a key
# What `counts` holds: different keys of the points and of the blocks that these reach, points without a key, whether a
# table is too full
HELD, MADE, LOST, FULL = range(4)
LEAST, EACH, MORE = 1024, 4, 16  # smallest table, points for a place at first, factor of the next table
ALL_WAYS = 27  # blocks around a block and itself; 9 in the plane


@formula
def first_place(key, size):
    """Place (dimensionless) of a key in a table of `size` places, a power of two; products stay below 2^48."""
    x, y, z = key & COORDINATE, (key >> BITS) & COORDINATE, key >> (2 * BITS)
    return ((x * 73856093) ^ (y * 19349663) ^ (z * 83492791)) & (size - 1)


@cuda_formula
def enter(key, entry, table, listed, counts, number):
    """Enter a key in the table as `entry`; if it is new, also at the end of `listed`, of length counts[number]."""
    size = table.shape[0]
    at = first_place(key, size)
    for _ in range(TRIES):
        held = table[at]
        if held == EMPTY:
            held = cuda.atomic.cas(table, at, EMPTY, entry)
            if held == EMPTY:
                listed[cuda.atomic.add(counts, number, 1)] = key
                return
        if held == entry:
            return
        at = (at + 1) & (size - 1)
    counts[FULL] = 1


@row_kernel
def clear_table(at, counts, table):
    """No key in the table, and counts of 0."""
    table[at] = EMPTY
    if at < counts.shape[0]:
        counts[at] = 0


@cuda_formula
def enter_point(key, before, table, listed, counts):
    """The key of a point, -1 for none, where it is not that of the point before."""
    if key < 0:
        cuda.atomic.add(counts, LOST, 1)
    elif key != before:
        enter(key, key, table, listed, counts, HELD)


@row_kernel
def enter_keys(i, table, listed, counts, keys):
    """The different keys of points."""
    enter_point(keys[i], keys[i - 1] if i > 0 else EMPTY, table, listed, counts)


@formula
def key_step(way, low, width, layers):
    """Difference of keys (dimensionless) from a block to the `way`-th of those from `low` on, `width` along an axis."""
    x, y, z = way % width, way // width % width, way // (width * width)
    return (low + x) + ((low + y) << BITS) + ((low + z if layers > 1 else 0) << (2 * BITS))


@cuda_kernel
def enter_reached(listed, low, width, layers, counts, table, reached):
    """The different keys of all blocks in reach, as their complements; `layers` along z are `width` or 1."""
    ways = width * width * layers
    if counts[FULL] == 0:
        for at in range(cuda.grid(1), counts[HELD] * ways, cuda.gridsize(1)):
            key = listed[at // ways] + key_step(at % ways, low, width, layers)
            enter(key, ~key, table, reached, counts, MADE)


@row_kernel(lanes=ALL_WAYS, rows_of="keys")
def find_neighbours(b, lane, keys, neighbour):
    """Numbers of the blocks around each block, -1 for none; x runs fastest."""
    way, ways = lane[0], neighbour.shape[1]
    if way < ways:
        key = keys[b] + key_step(way, -1, 3, ways // 9)
        place = lower_bound(keys, key)
        neighbour[b, way] = place if place < keys.shape[0] and keys[place] == key else -1


def make_table(points, entries, dim, low, high):
    """(blocks from `low` to `high` around those of points along each axis, how many points have no block).

    points   their number
    entries  calls that enter keys of the points' blocks, with (table, list of different keys, counts)
    """
    xp, width = device.cupy_or_numpy(), high - low + 1
    layers = width if dim == 3 else 1
    size = 1 << (max(LEAST, points // EACH) - 1).bit_length()
    while True:
        counts = device.empty(4, np.int32)
        table, listed, reached = (device.empty(size, np.int64) for _ in range(3))
        clear_table(counts, table)
        for enter_points in entries:
            enter_points(table, listed, counts)
        enter_reached(listed, low, width, layers, counts, table, reached)
        _, made, lost, full = device.as_cupy(counts).tolist()
        if not full:
            break
        size *= MORE
    ordered = device.as_numba(xp.sort(device.as_cupy(reached)[:made]))
    neighbour = device.empty((made, 3**dim), np.int32)
    find_neighbours(ordered, neighbour)
    return Blocks(ordered, neighbour), lost
