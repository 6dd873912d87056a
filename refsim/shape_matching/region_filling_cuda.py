"""Filling of regions on a GPU: the threads of a block share a region, whose slots lie in shared memory."""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.backends.runtime import simulated
from refsim.shape_matching import WIDEST
from refsim.shape_matching.phases import EMPTY
from refsim.shape_matching.region_filling import LEVEL, NUMBER

MOST_SLOTS = (2 * WIDEST + 1) ** 3
SHARE = 1 if simulated() else 16  # threads of a block to each of its regions


@cuda_kernel(lanes=SHARE)
def regions(direct, rebuild, lattice, region, region_count):
    """Regions by filling level by level; all of them, or those marked in `rebuild`.

    A block takes its regions one after the other, each with all of its threads. Few are marked, and those stand side by
    side: the regions of a block are far apart, so that no block has many to fill.
    """
    entries = cuda.shared.array(MOST_SLOTS, np.int32)
    for s in range(cuda.blockIdx.x, region_count.shape[0], cuda.gridDim.x):
        wanted = True
        if rebuild is not None:
            wanted = rebuild[s] != 0
        if wanted:
            fill_shared(s, direct, entries, region, region_count)
            cuda.syncthreads()


@cuda_formula
def fill_shared(s, direct, entries, region, region_count):
    """The region of node s, filled by the threads of a block in `entries`, which they share."""
    slots, thread, step = region.shape[1], cuda.threadIdx.x, cuda.blockDim.x
    side = 1
    while side * side * side < slots:
        side += 2
    for slot in range(thread, slots, step):
        entries[slot] = next_to(s, slot, direct, side)
    if thread == 0:
        region_count[s] = 0
    cuda.syncthreads()
    for level in range(2, side // 2 + 1):
        for slot in range(thread, slots, step):
            if entries[slot] == EMPTY:
                other = reached(slot, level, direct, entries, side)
                if other != EMPTY:
                    entries[slot] = other | (level << LEVEL)
        cuda.syncthreads()
    count = 0
    for slot in range(thread, slots, step):
        entry = entries[slot]
        if entry != EMPTY:
            entry &= NUMBER
            count += 1
        region[s, slot] = entry
    cuda.atomic.add(region_count, s, count)


@formula
def cell_of(slot, side):
    """(x, y, z) of a slot among `side` cells along each axis."""
    over = ((1 << 16) + side - 1) // side  # times a number below 2^13: 2^16 of its whole quotient by `side`
    column = (slot * over) >> 16
    plane = (column * over) >> 16
    return plane, column - plane * side, slot - column * side


@formula
def next_to(s, slot, direct, side):
    """What passes 0 and 1 write into a slot of the region of node s: the node itself, and its direct neighbours."""
    x, y, z = cell_of(slot, side)
    a, b, e = x - side // 2, y - side // 2, z - side // 2
    found = EMPTY
    if -1 <= a <= 1 and -1 <= b <= 1 and -1 <= e <= 1:
        found = direct[s, (a + 1) * 9 + (b + 1) * 3 + e + 1]
        if found != EMPTY and (a != 0 or b != 0 or e != 0):
            found |= 1 << LEVEL
    return found


@formula
def reached(slot, level, direct, entries, side):
    """What pass `level` writes into an empty slot of a region: the node there, if it is a direct neighbour of a member.

    The same passes as in `fill_region`, seen from the slot that is written, so that threads can share a region, whose
    slots are `entries`. Those of the pass before are fewer than `level` cells from the middle along each axis.
    """
    found, first, last = EMPTY, side // 2 - level + 1, side // 2 + level - 1
    x, y, z = cell_of(slot, side)
    a, b, e = max(x - last, -1), max(y - last, -1), max(z - last, -1)
    low_b, low_e, high_a, high_b, high_e = b, e, min(x - first, 1), min(y - first, 1), min(z - first, 1)
    while found == EMPTY and a <= high_a and b <= high_b and e <= high_e:
        entry = entries[((x - a) * side + y - b) * side + z - e]
        if entry != EMPTY and entry >> LEVEL == level - 1:
            found = direct[entry & NUMBER, (a + 1) * 9 + (b + 1) * 3 + e + 1]
        e += 1
        if e > high_e:
            b, e = b + 1, low_e
        if b > high_b:
            a, b = a + 1, low_b
    return found
