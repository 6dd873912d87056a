"""The neighbour list as kernels see it: rows in memory on the CPU, columns on the GPU."""

from __future__ import annotations

from typing import Any, NamedTuple

from refsim.compile import formula


class NeighbourRows(NamedTuple):
    """CPU list: neighbours of i are entries[start[i] : start[i] + count[i]]."""

    start: Any  # (n,) int64
    count: Any  # (n,) int32
    entries: Any  # (capacity,) int32


class NeighbourColumns(NamedTuple):
    """GPU list: the k-th neighbour of i is entries[k * n + i], so that neighbouring threads read neighbouring words."""

    count: Any  # (n,) int32
    entries: Any  # (capacity * n,) int32


@formula
def cpu_row(neighbours, i):  # noqa: ANN001, ANN201  (types are Numba's)
    """(first, stride, count) of row i of a NeighbourRows."""
    return neighbours.start[i], 1, neighbours.count[i]


@formula
def cuda_row(neighbours, i):  # noqa: ANN001, ANN201
    """(first, stride, count) of column i of a NeighbourColumns."""
    return i, neighbours.count.shape[0], neighbours.count[i]
