"""Fields of a particle that a loop over neighbours reads together, four numbers a row, and ahead of their use.

A loop that reads an entry of the list, then that neighbour's fields, then computes, waits for the memory twice in each
round. Here entries are read three rounds ahead and fields one.
"""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import formula


def places_with_masses(position, mass, scratch):
    """Rows (x, m) in scratch memory."""
    placed = scratch.array("placed", (position.shape[0], 4), position.dtype)
    device.packed((position,), (mass,), (placed,))
    return placed


def packed_fields(position, velocity, mass, density, pressure, normal, scratch):
    """Rows (x, m), (v, p) and, unless `normal` is None, (normal, density) in scratch memory."""
    names = ("placed", "moving") if normal is None else ("placed", "moving", "directed")
    rows = tuple(scratch.array(name, (position.shape[0], 4), position.dtype) for name in names)
    if normal is None:
        device.packed((position, velocity), (mass, pressure), rows)
        return (*rows, None)
    device.packed((position, velocity, normal), (mass, pressure, density), rows)
    return rows


@formula
def entry(neighbours, first, stride, count, k):
    """Entry k of a row that is not empty, the last one if there is none (`rows.row_of`)."""
    return neighbours.entries[first + min(np.uint64(k), count - np.uint64(1)) * stride]
