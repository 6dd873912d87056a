"""NumPy oracle of the neighbour search: all pairs, in blocks of rows."""

import numpy as np

BLOCK_BYTES = 2 * 2**20  # stays in the cache


def nearest_image(separation, period):
    """Separations (..., 3) [m] to the nearest image: x - L round(x/L), L the period's lengths, 0 for none."""
    length = np.array(period[:3], dtype=float)
    return separation - length * np.round(separation / np.where(length > 0, length, np.inf))


def separations(query, source, period=None):
    """Of all pairs x_query - x_source (n, m, 3), to the nearest image, and its length (n, m) [m]."""
    separation = np.empty((len(query), len(source), 3))
    for k in range(3):  # quicker than an axis of three
        np.subtract.outer(query[:, k], source[:, k], out=separation[..., k])
    if period is not None:
        separation = nearest_image(separation, period)
    x, y, z = np.moveaxis(separation, -1, 0)
    return separation, np.sqrt(x * x + y * y + z * z)


def pair_blocks(query, source, rows=None, period=None):
    """Yield (place, separation, distance) for blocks of queries against all sources, in float64.

    query (n, 3), source (m, 3) [m]; rows: indices of the wanted queries, all by default; period: lengths [m] of a
    periodic box first, or None. `place` is the block's slice of the result, separation (b, m, 3) = x_query - x_source
    to the nearest image, distance (b, m).
    """
    query, source = np.asarray(query, dtype=float), np.asarray(source, dtype=float)
    query = query if rows is None else query[rows]
    size = max(1, BLOCK_BYTES // (8 * 8 * max(1, len(source))))
    for first in range(0, len(query), size):
        place = slice(first, min(first + size, len(query)))
        yield place, *separations(query[place], source, period)


def other_particles(place, count, rows=None):
    """Mask (b, count), False where a query of the block meets itself."""
    index = np.arange(count)[place] if rows is None else np.asarray(rows)[place]
    return index[:, None] != np.arange(count)[None, :]


def neighbour_list(position, radius, rows=None, period=None):
    """For each query the sorted array of the other particles nearer than `radius` [m]."""
    rows_of_pairs = []
    for place, _, distance in pair_blocks(position, position, rows, period):
        near = (distance < radius) & other_particles(place, len(position), rows)
        rows_of_pairs.extend(np.flatnonzero(line) for line in near)
    return rows_of_pairs
