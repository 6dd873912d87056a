"""Region sums over boxes of cells, one axis after the other, after FastLSM (Rivers & James 2007).

A region whose members are all nodes of its body in the box of (2 w + 1)^3 cells around it is summed as 2 w + 1 sums of
planes of 2 w + 1 sums of rows of 2 w + 1 cells, which neighbouring regions share: 3 (2 w + 1) additions instead of
(2 w + 1)^3. Every other region is summed member by member. Sums stand in float64, because their terms are taken from
one point of the body and not from the region's own node.

Contents: Boxes, boxes_of; operations fast_summation.match, fast_summation.pull, fast_summation.region_motion,
fast_summation.damp.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np

from refsim.operation import REGISTRY, register
from refsim.solids import Lattice

WIDEST = 17  # numbers that a cell sums


class Boxes(NamedTuple):
    """The bodies' cells in one box of rows, planes and columns, with w empty cells wherever two rows or bodies meet.

    A window of 2 w + 1 cells along any axis then never holds what is not beside its middle: windows of rows and planes
    need not be cut at the box's sides, and the first and the last w planes, which are empty too, have none.
    """

    node: Any  # (cells,) int32 node in each cell, -1 for none
    cell: Any  # (S,) int32 cell of each node
    origin: Any  # (S,) int32 node nearest the middle of each node's body
    side: Any  # (3,) int32 cells along each axis
    first: Any  # (17, cells) float64, for sums on the way
    second: Any  # (17, cells) float64, likewise


def boxes_of(lattice: Lattice, half_width: int) -> Boxes:
    """Cells of all bodies, one body above the other."""
    cell = np.asarray(lattice.cell, dtype=np.int64)
    place, side, height = np.zeros_like(cell), np.ones(3, np.int64), 0
    origin = np.zeros(len(cell), np.int32)
    for first, end in zip(lattice.first[:-1], lattice.first[1:]):
        if first == end:
            continue
        own = cell[first:end] - cell[first:end].min(0)
        origin[first:end] = first + ((own - own.mean(0)) ** 2).sum(1).argmin()
        own[:, 2] += height
        place[first:end] = own
        side = np.maximum(side, own.max(0) + 1)
        height = int(own[:, 2].max()) + 1 + half_width
    place[:, 0] += half_width
    side += (2 * half_width, half_width, half_width)
    flat = (place[:, 0] * side[1] + place[:, 1]) * side[2] + place[:, 2]
    node = np.full(int(side.prod()), -1, np.int32)
    node[flat] = np.arange(len(cell))
    rows = np.zeros((WIDEST, len(node)))
    return Boxes(node, flat.astype(np.int32), origin, side.astype(np.int32), rows, rows.copy())


for _name in ("match", "pull", "region_motion", "damp"):
    _plain = REGISTRY[f"shape_matching.{_name}"]
    register(
        dataclasses.replace(
            _plain,
            name=f"fast_summation.{_name}",
            folder="refsim.shape_matching.fast_summation",
            paper="Rivers & James 2007",
            tolerance=2 * _plain.tolerance,
            rarely=True,
        )
    )
