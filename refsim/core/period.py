"""A periodic box as every pass and the neighbour search see it.

Positions are never wrapped: a particle that leaves the box goes on beside it, so that displacements, energies and
checkpoints are those of its path. Every separation is taken to the nearest image.
"""

from typing import NamedTuple

import numpy as np

Lengths = tuple[float, float, float]


class Period(NamedTuple):
    """Lengths [m] of a periodic box and their inverses; both 0 along axes without a period."""

    x: float  # length of the periodic box along x, 0 without a period [m]
    y: float  # length of the periodic box along y, 0 without a period [m]
    z: float  # length of the periodic box along z, 0 without a period [m]
    inverse_x: float  # 1 over the length along x, 0 without a period [1/m]
    inverse_y: float  # 1 over the length along y, 0 without a period [1/m]
    inverse_z: float  # 1 over the length along z, 0 without a period [1/m]


def period_group(lengths: Lengths, dtype: str) -> Period:
    """A periodic box of `lengths` [m], 0 where there is no period."""
    real = np.dtype(dtype).type
    return Period(*(real(v) for v in lengths), *(real(1 / v if v else 0.0) for v in lengths))


def wrapped(position: np.ndarray, lengths: Lengths, lower: Lengths) -> np.ndarray:
    """Positions (n, 3) [m] of the images inside a periodic box; as they are along axes of length 0."""
    inside = np.array(position)
    for axis in np.flatnonzero(lengths):
        x = inside[:, axis].astype(float)
        inside[:, axis] = x - lengths[axis] * np.floor((x - lower[axis]) / lengths[axis])
    return inside
