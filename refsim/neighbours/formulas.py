"""Cells of the neighbour search: integer coordinates packed into one sortable 63-bit key, x lowest.

The domain is unbounded: only occupied cells exist, as a sorted list of keys. Coordinates beyond 2^20 cells
from the origin are clamped, which never separates two neighbours (clamping does not increase distances);
it only makes the far cells fuller.
"""

import math

from refsim.backends.compile import formula

BITS = 21
OFFSET = 1 << 20
LARGEST = (1 << 21) - 2  # leaves a cell free on either side, so that key +- 1 never wraps


@formula
def cell_coordinate(x, inverse_cell):
    """Integer cell coordinate = floor(x/cell) + OFFSET of x [m], clamped to 1..LARGEST; NaN goes to the first cell."""
    scaled = float(x) * inverse_cell
    if not scaled > 1.0 - OFFSET:
        return 1
    if scaled >= LARGEST - OFFSET:  # before it becomes an integer, which it may be too large for
        return LARGEST
    return int(math.floor(scaled)) + OFFSET  # noqa: RUF046  (in CUDA floor gives a float)


@formula
def cell_key(cx, cy, cz):
    """Sortable key k = 2^42 c_z + 2^21 c_y + c_x of a cell, dimensionless; neighbours along x have consecutive keys."""
    return (cz << (2 * BITS)) | (cy << BITS) | cx


@formula
def block_key(cell):
    """Key (dimensionless) of the block = floor(c/2) of two cells along each axis that holds a cell of this key."""
    mask = (1 << BITS) - 1
    return cell_key((cell & mask) >> 1, ((cell >> BITS) & mask) >> 1, cell >> (2 * BITS + 1))


@formula
def squared_between(low, high, a, b):
    """Largest squared difference = max |u - v|^2 [m^2] of u in the box [low, high] of row a and v in that of row b."""
    squared = low[a, 0] - low[a, 0]
    for c in range(3):
        apart = max(high[a, c] - low[b, c], high[b, c] - low[a, c])
        squared += apart * apart
    return squared


@formula
def at_bounds(i, position, bounds):
    """A flag: particle i at x = lower or upper plane of `bounds` [m], where the latest step may have stopped it."""
    for c in range(3):  # noqa: SIM110  (Numba compiles no generators)
        if position[i, c] == bounds.lower[c] or position[i, c] == bounds.upper[c]:
            return True
    return False


@formula
def lower_bound(keys, key):
    """First position p (dimensionless) in the sorted `keys` with keys[p] >= key."""
    low = 0
    high = len(keys)
    while low < high:
        middle = (low + high) >> 1
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low
