"""Tables of the sparse grid: its blocks of nodes, and points by cell."""

from typing import Any, NamedTuple


class Blocks(NamedTuple):
    """Blocks of 64 nodes: 4 x 4 x 4 in space, 8 x 8 in the plane; node 64 b + l is the l-th of block b, x fastest."""

    keys: Any  # (b,) int64, ascending
    neighbour: Any  # (b, 27 or 9) int32, number of the block a step away in each direction, -1 for none


class PointList(NamedTuple):
    """Points by cell: those of cell i are point[first[i] : first[i + 1]], in the order of their numbers."""

    first: Any  # (nodes + 1,) int32
    point: Any  # (points in some block,) int32; on a GPU the end is unused capacity for the others
    cell: Any  # (points,) int32, the cell of each point, -1 for none
