"""Cells of the neighbour search: integer coordinates packed into one sortable 63-bit key, x lowest.

The domain is unbounded: only occupied cells exist, as a sorted list of keys. Coordinates beyond 2^20 cells
from the origin are clamped, which never separates two neighbours (clamping does not increase distances);
it only makes the far cells fuller.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from refsim.backends.compile import formula
from refsim.core.effect import int32

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


@formula(ordered=True)
def nearest_image(separation, length, inverse):
    """d = x - L floor(x/L + 1/2) [m], a component of a separation to the nearest image in a period L; both 0: none."""
    real = type(separation)
    return separation - length * real(math.floor(separation * inverse + real(0.5)))


@formula
def to_nearest_image(dx, dy, dz, period):
    """Separation (dx, dy, dz) [m] to the nearest image, d = x - L floor(x/L + 1/2); as it is without a `period`."""
    if period is not None:
        dx = nearest_image(dx, period.x, period.inverse_x)
        dy = nearest_image(dy, period.y, period.inverse_y)
        dz = nearest_image(dz, period.z, period.inverse_z)
    return dx, dy, dz


class PeriodicCells(NamedTuple):
    """Cells of a periodic box: their number along each axis and 1 over their width; 0 along axes without a period."""

    x: int
    y: int
    z: int
    inverse_x: float  # [1/m]
    inverse_y: float
    inverse_z: float


def periodic_cells(period: Any, reach: float) -> PeriodicCells | None:
    """Cells that fit a period's lengths and are no narrower than `reach` [m]; None without a period."""
    if period is None:
        return None
    lengths = [float(length) for length in period[:3]]
    numbers = [int(length / reach * (1 - 1e-6)) for length in lengths]
    widths = (number / length if length > 0 else 0.0 for number, length in zip(numbers, lengths))
    return PeriodicCells(*map(int32, numbers), *widths)


@formula
def periodic_coordinate(x, inverse_cell, number, inverse_width):
    """Coordinate of a cell = 1 + floor(x/width) mod number of x [m]; without a period that of unbounded space."""
    if number == 0:
        return cell_coordinate(x, inverse_cell)
    scaled = float(x) * inverse_width
    if not abs(scaled) < 1e15:  # of NaN and infinity, whose cell does not matter
        return 1
    cell = math.floor(scaled)
    return int(cell - number * math.floor(cell / number)) + 1


@formula
def key_of_place(x, y, z, inverse_cell, cells):
    """Sortable key = 2^42 c_z + 2^21 c_y + c_x, dimensionless, of the cell of (x, y, z) [m]; of a box of `cells`."""
    if cells is None:
        return cell_key(
            cell_coordinate(x, inverse_cell), cell_coordinate(y, inverse_cell), cell_coordinate(z, inverse_cell)
        )
    return cell_key(
        periodic_coordinate(x, inverse_cell, cells.x, cells.inverse_x),
        periodic_coordinate(y, inverse_cell, cells.y, cells.inverse_y),
        periodic_coordinate(z, inverse_cell, cells.z, cells.inverse_z),
    )


@formula
def beside(cell, k, number):
    """The k-th smallest, k = 0 to 2, of the coordinates of a cell and of those on either side, dimensionless; -1: none.

    number  of cells along the axis; 0 without a period
    """
    if number == 2:  # both sides are one cell
        return k + 1 if k < 2 else -1
    if number > 0 and cell == 1:
        return k + 1 if k < 2 else number
    if number > 0 and cell == number:
        return 1 if k == 0 else number - 2 + k
    return cell + k - 1


@formula
def periodic_row(key, k, layers, cells):
    """(first, last) key = 2^42 c_z + 2^21 c_y + c_x (dimensionless) of a piece of a row around a cell.

    Rows go along x; without a cell last < first. There are 3 `layers` rows, each of two pieces, since one at the border
    goes on at the other side of the box; k counts the pieces in the order of their keys.
    """
    mask = (1 << BITS) - 1
    cx, cy, cz = key & mask, (key >> BITS) & mask, key >> (2 * BITS)
    cy = beside(cy, k // 2 % 3, cells.y)
    if layers == 3:
        cz = beside(cz, k // 6, cells.z)
    second = k % 2 == 1
    low, high = cx - 1, cx + 1
    if cells.x > 0:
        low, high = max(low, 1), min(high, cells.x)
    torn = cells.x > 2 and (cx == 1 or cx == cells.x)
    if torn and second == (cx == 1):
        low, high = cells.x + 1 - cx, cells.x + 1 - cx
    elif second and not torn:
        low, high = 1, 0
    if cy < 0 or cz < 0:
        low, high, cy, cz = 1, 0, 0, 0
    return cell_key(low, cy, cz), cell_key(high, cy, cz)


@formula
def row_around(key, k, layers, cells):
    """(first, last) key = 2^42 c_z + 2^21 c_y + c_x (dimensionless) of row k of the 3 `layers` rows around a cell.

    With the `cells` of a periodic box k counts pieces of rows, as in `periodic_row`.
    """
    if cells is not None:
        return periodic_row(key, k, layers, cells)
    middle = key + (np.int64(k % 3 - 1) << BITS)
    if layers == 3:
        middle += np.int64(k // 3 - 1) << (2 * BITS)
    return middle - 1, middle + 1


@formula
def block_key(cell):
    """Key (dimensionless) of the block = floor(c/2) of two cells along each axis that holds a cell of this key."""
    mask = (1 << BITS) - 1
    return cell_key((cell & mask) >> 1, ((cell >> BITS) & mask) >> 1, cell >> (2 * BITS + 1))


@formula
def squared_between(low, high, a, b, first):
    """Largest squared difference = max |u - v|^2 [m^2] of u in the box [low, high] of row a and v in that of row b.

    Boxes stand in column `first` and the two behind.
    """
    squared = low[a, first] - low[a, first]
    for c in range(first, first + 3):
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
def known_before(i, j, position, bounds):
    """A flag: both x(t - dt) = x - dt v [m] hold, as no plane may have stopped i or j in the latest step."""
    if bounds is not None:
        return not (at_bounds(i, position, bounds) or at_bounds(j, position, bounds))
    return True


@formula(ordered=True)
def squared_distance_before(i, j, position, velocity, shift, drift, period):
    """r^2 = |x_i - x_j|^2 [m^2] before a step of `drift` [s] and, unless it is None, by a shift, s = L way.

    The same to the bit wherever it is called: a pair at the limit counts among all and in the list, or in neither.
    """
    dx = before(0, i, position, velocity, shift, drift) - before(0, j, position, velocity, shift, drift)
    dy = before(1, i, position, velocity, shift, drift) - before(1, j, position, velocity, shift, drift)
    dz = before(2, i, position, velocity, shift, drift) - before(2, j, position, velocity, shift, drift)
    dx, dy, dz = to_nearest_image(dx, dy, dz, period)
    return dx * dx + dy * dy + dz * dz


@formula(ordered=True)
def before(c, i, position, velocity, shift, drift):
    """x(t - dt) = x - dt v - s [m] along axis c."""
    x = position[i, c] - drift * velocity[i, c]
    if shift is not None:
        x -= longest_of(i, shift[1], shift[2], x) * shift[0][i, c]
    return x


@formula
def longest_of(i, longest_shift, body, zero_like):
    """v_max dt [m] = `longest_shift` of i's body, the only one where none are told apart; 0 without shifts."""
    if longest_shift is None:
        return type(zero_like)(0)
    if body is None:
        return longest_shift[0]
    return longest_shift[body[i]]


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
