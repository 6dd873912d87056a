"""Filling of regions on a CPU, where a thread fills a region; `region_filling_cuda` has the CUDA kernel."""

from refsim.backends.compile import formula, kernel
from refsim.shape_matching.formulas import slot_offset
from refsim.shape_matching.phases import EMPTY

LEVEL = 28  # bits of a node's number; the bits above hold its level while a region is filled
NUMBER = (1 << LEVEL) - 1


@kernel(ordered=True)
def regions(s, direct, rebuild, lattice, region, region_count):
    """Region of node s by filling level by level; of every node, or of those marked in `rebuild`."""
    wanted = True
    if rebuild is not None:
        wanted = rebuild[s] != 0
    if wanted:
        region_count[s] = fill_region(s, direct, region)


@formula
def fill_region(s, direct, region):
    """Members of the region of node s, at most w steps away over direct neighbours; returns their number.

    w + 1 passes over the box of slots: pass 0 writes the node itself, pass p the direct neighbours of the nodes that
    pass p - 1 wrote, which have its level (Shao & Song M15: not of those that pass p writes).
    """
    slots = region.shape[1]
    side = 1
    while side * side * side < slots:
        side += 2
    middle = slots // 2
    for slot in range(slots):
        region[s, slot] = EMPTY
    count = 0
    if direct[s, 13] != EMPTY:
        region[s, middle] = s
        count = 1
    for level in range(1, side // 2 + 1):
        for slot in range(slots):
            entry = region[s, slot]
            if entry != EMPTY and entry >> LEVEL == level - 1:
                node = entry & NUMBER
                for near in range(27):
                    a, b, e = slot_offset(near, 1)
                    target = slot + (a * side + b) * side + e
                    if region[s, target] == EMPTY and direct[node, near] != EMPTY:
                        region[s, target] = direct[node, near] | (level << LEVEL)
                        count += 1
    for slot in range(slots):
        if region[s, slot] != EMPTY:
            region[s, slot] &= NUMBER
    return count
