"""Stand-in for the paper's rival: every region is searched anew in every step, breadth first.

It is not the method of Iwasaki et al. 2010, with which figure 7 compares.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from refsim import Simulation
from refsim.backends.compile import cpu_kernel, formula
from refsim.shape_matching.phases import EMPTY


@formula
def _search(s: int, direct: Any, cell: Any, half_width: int, region: Any) -> int:
    """Members of the region of node s by a queue of its own; how many there are."""
    side = 2 * half_width + 1
    slots = side * side * side
    queue = np.empty(slots, np.int32)
    level = np.empty(slots, np.int32)
    for slot in range(slots):
        region[s, slot] = EMPTY
    if direct[s, 13] == EMPTY:
        return 0
    queue[0], level[0] = s, 0
    region[s, slots // 2] = s
    head, count = 0, 1
    while head < count:
        node = queue[head]
        if level[head] < half_width:
            for near in range(27):
                other = direct[node, near]
                if other != EMPTY:
                    a = cell[other, 0] - cell[s, 0] + half_width
                    b = cell[other, 1] - cell[s, 1] + half_width
                    e = cell[other, 2] - cell[s, 2] + half_width
                    slot = (a * side + b) * side + e
                    if region[s, slot] == EMPTY:
                        region[s, slot] = other
                        queue[count], level[count] = other, level[head] + 1
                        count += 1
        head += 1
    return count


@cpu_kernel(ordered=True)
def all_regions(direct: Any, cell: Any, half_width: int, region: Any, region_count: Any) -> None:
    """Every region, breadth first."""
    for s in range(region_count.shape[0]):
        region_count[s] = _search(s, direct, cell, half_width, region)


class RegionSearch:
    """The rival's search on the tables of a simulation."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation, self.cell = simulation, simulation.plan.grid.solids.lattice.cell

    def __call__(self) -> None:
        field = self.simulation.fields
        width = np.int32((round(field["region"].shape[1] ** (1 / 3)) - 1) // 2)
        all_regions(field["direct"], self.cell, width, field["region"], field["region_count"])
