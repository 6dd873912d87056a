"""The cells over which fast summation adds up regions, after FastLSM (Rivers & James 2007)."""

from typing import Any, NamedTuple

import numpy as np

from refsim.core.effect import Lattice

WIDEST = 17  # numbers that a cell sums


class Boxes(NamedTuple):
    """The bodies' cells in one box of planes, rows and columns, with w empty cells wherever two rows or bodies meet.

    A window of 2 w + 1 cells along any axis then holds cells of one row and one body only: windows of rows and planes
    need not be truncated at the box's sides. The first and the last w planes are empty and have no windows. Planes
    follow z, rows y and columns x, so that nodes are in the order of their cells.
    """

    node: Any  # (cells,) int32 node in each cell, -1 for none
    cell: Any  # (S,) int32 cell of each node
    origin: Any  # (S,) int32 node nearest the middle of each node's body
    side: Any  # (3,) int32 planes, rows and columns
    planes: Any  # (planes, 8) int32 of each: nodes [0, 1), rows of its nodes [2, 3), rows [4, 5) and columns [6, 7)
    #              of the nodes at most w planes away
    first: Any  # (17, cells) float64, work space: terms of each cell, partial sums
    second: Any  # (17, cells) float64, work space: sums over boxes


def boxes_of(lattice: Lattice, half_width: int) -> Boxes:
    """Cells of all bodies, one body above the other."""
    cell = np.asarray(lattice.cell, dtype=np.int64)
    place, side, height = np.zeros_like(cell), np.ones(3, np.int64), 0
    origin = np.zeros(len(cell), np.int32)
    for first, end in zip(lattice.first[:-1], lattice.first[1:]):
        if first == end:
            continue
        cells = cell[first:end] - cell[first:end].min(0)
        origin[first:end] = first + ((cells - cells.mean(0)) ** 2).sum(1).argmin()
        cells[:, 2] += height
        place[first:end] = cells
        side = np.maximum(side, cells.max(0) + 1)
        height = int(cells[:, 2].max()) + 1 + half_width
    place[:, 2] += half_width
    columns, rows, planes = (int(n) for n in side + (half_width, half_width, 2 * half_width))
    flat = (place[:, 2] * rows + place[:, 1]) * columns + place[:, 0]
    node = np.full(planes * rows * columns, -1, np.int32)
    node[flat] = np.arange(len(cell))
    sums = np.zeros((WIDEST, len(node)))
    sides = np.array([planes, rows, columns], np.int32)
    ranges = _ranges(place, planes, half_width)
    return Boxes(node, flat.astype(np.int32), origin, sides, ranges, sums, sums.copy())


def _ranges(place: np.ndarray, planes: int, half_width: int) -> np.ndarray:
    """Boxes.planes of nodes in cells (column, row, plane)."""
    ranges = np.zeros((planes, 8), np.int32)
    border = np.searchsorted(place[:, 2], np.arange(planes + 1))
    ranges[:, 0], ranges[:, 1] = border[:-1], border[1:]
    for p in range(planes):
        cells = place[border[p] : border[p + 1]]
        if len(cells):
            ranges[p, 2:4] = cells[:, 1].min(), cells[:, 1].max() + 1
        near = place[border[max(p - half_width, 0)] : border[min(p + half_width + 1, planes)]]
        if len(near):
            ranges[p, 4:8] = near[:, 1].min(), near[:, 1].max() + 1, near[:, 0].min(), near[:, 0].max() + 1
    return ranges
