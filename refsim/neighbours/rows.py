"""The neighbour list as kernels see it: rows in memory on the CPU, columns on the GPU."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from refsim.backends.compile import cuda, formula


class NeighbourRows(NamedTuple):
    """CPU list: neighbours of i are entries[start[i] : start[i] + count[i]]."""

    start: Any  # (n,) int64
    count: Any  # (n,) int32
    entries: Any  # (capacity,) uint32


class NeighbourColumns(NamedTuple):
    """GPU list: the k-th neighbour of i is entries[k * n + i], so that neighbouring threads read neighbouring words."""

    count: Any  # (n,) int32
    entries: Any  # (capacity * n,) uint32
    lanes: Any = (np.int32(0),)  # its length, known when a kernel is compiled: threads that share a column


@formula
def cpu_row(neighbours, i):  # noqa: ANN001, ANN201  (types are Numba's)
    """(first, stride, count) of row i of a NeighbourRows; unsigned: negative indices would cost a test each."""
    return np.uint64(neighbours.start[i]), np.uint64(1), np.uint64(neighbours.count[i])


@formula
def cuda_row(neighbours, i):  # noqa: ANN001, ANN201
    """(first, stride, count) of column i of a NeighbourColumns; unsigned like `cpu_row`."""
    return np.uint64(i), np.uint64(neighbours.count.shape[0]), np.uint64(neighbours.count[i])


@formula
def cuda_lane(place, neighbours):  # noqa: ANN001, ANN201
    """(particle, lane) of thread `place` in a kernel with `lanes`: that many neighbouring threads share a particle."""
    lanes = len(neighbours.lanes)
    return place // lanes, place % lanes


@formula
def cuda_lane_row(neighbours, i, lane):  # noqa: ANN001, ANN201
    """(first, stride, count) of a lane's share of column i: one entry out of as many as there are lanes."""
    return cuda_share_row(neighbours, i, lane, len(neighbours.lanes))


@formula
def cuda_share_row(columns, i, lane, lanes):  # noqa: ANN001, ANN201
    """(first, stride, count) of a lane's share of column i of any list, the walls', too."""
    n = columns.count.shape[0]
    own = (columns.count[i] + lanes - 1 - lane) // lanes
    return np.uint64(i + lane * n), np.uint64(lanes * n), np.uint64(own)


@formula
def lanes_sum(value, lane, neighbours):  # noqa: ANN001, ANN201
    """Sum of the lanes' shares, the same in all of them and always in the same order."""
    return sum_of_lanes(value, lane, len(neighbours.lanes))


@formula
def sum_of_lanes(value, lane, lanes):  # noqa: ANN001, ANN201
    """Sum of what so many neighbouring threads hold, a power of two, the same in all and always in the same order."""
    if lanes > 1:
        mask = lanes_mask(lane, lanes)
        step = 1
        while step < lanes:
            value += cuda.shfl_xor_sync(mask, value, step)
            step *= 2
    return value


@formula
def lanes_mask(lane, lanes):  # noqa: ANN001, ANN201
    """Bits of a warp's threads that share a row with this one."""
    return np.uint32((1 << lanes) - 1) << np.uint32(cuda.laneid - lane)


@formula
def counted_lanes(flag, lane, lanes):  # noqa: ANN001, ANN201
    """(how many lanes before this one raise their flag, how many of all)."""
    before, together = 0, 1 if flag else 0
    if lanes > 1:
        mask = lanes_mask(lane, lanes)
        raised = np.uint32(cuda.ballot_sync(mask, flag)) >> np.uint32(cuda.laneid - lane)
        raised &= np.uint32((1 << lanes) - 1)
        before = np.int64(cuda.popc(raised & np.uint32((1 << lane) - 1)))
        together = np.int64(cuda.popc(raised))
    return before, together
