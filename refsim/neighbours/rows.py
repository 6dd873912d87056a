"""The neighbour list as kernels see it: rows in memory on the CPU, columns on the GPU."""

from typing import Any, NamedTuple

import numpy as np
from numba import types

from refsim.backends.compile import formula, overloaded


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


def row_of(neighbours, i, lane=None):  # noqa: ANN001, ANN201
    """(first, stride, count) of i's neighbours in `entries`, or of the share of lane (thread, threads to a row)."""
    if hasattr(neighbours, "start"):
        return cpu_row(neighbours, i)
    return cuda_row(neighbours, i) if lane is None else cuda_share_row(neighbours, i, lane[0], lane[1])


def _row_of(neighbours, i, lane=None):  # noqa: ANN001, ANN202
    if "start" in neighbours.fields:
        return lambda neighbours, i, lane=None: cpu_row(neighbours, i)
    if lane is None or isinstance(lane, (types.NoneType, types.Omitted)):
        return lambda neighbours, i, lane=None: cuda_row(neighbours, i)
    return lambda neighbours, i, lane=None: cuda_share_row(neighbours, i, lane[0], lane[1])


def first_lane(lane):  # noqa: ANN001, ANN201
    """Whether this thread writes what the lanes of its row have found together; True on a CPU."""
    return lane is None or lane[0] == 0


def _first_lane(lane):  # noqa: ANN001, ANN202
    return (lambda lane: True) if isinstance(lane, types.NoneType) else (lambda lane: lane[0] == 0)


def over_lanes(value, lane):  # noqa: ANN001, ANN201
    """Sum of the lanes' shares, the same in all of them and always in the same order; the value itself on a CPU."""
    return value if lane is None else _sum_of_lanes()(value, lane[0], lane[1])


def _over_lanes(value, lane):  # noqa: ANN001, ANN202
    if isinstance(lane, types.NoneType):
        return lambda value, lane: value
    sum_of_lanes = _sum_of_lanes()
    return lambda value, lane: sum_of_lanes(value, lane[0], lane[1])


def _sum_of_lanes() -> Any:
    from refsim.backends.primitives import sum_of_lanes  # loads numba.cuda, which a CPU does without

    return sum_of_lanes


for _function, _chosen in ((row_of, _row_of), (first_lane, _first_lane), (over_lanes, _over_lanes)):
    overloaded(_function, _chosen)


@formula
def add_vector(array, i, lane, vector):  # noqa: ANN001, ANN201
    """array[i] += the three components, which all lanes of the row hold."""
    if first_lane(lane):
        array[i, 0] += vector[0]
        array[i, 1] += vector[1]
        array[i, 2] += vector[2]


@formula
def set_vector(array, i, lane, vector):  # noqa: ANN001, ANN201
    """array[i] = the three components, which all lanes of the row hold."""
    if first_lane(lane):
        array[i, 0] = vector[0]
        array[i, 1] = vector[1]
        array[i, 2] = vector[2]


@formula
def lane_slots(lane):  # noqa: ANN001, ANN201
    """(first, step) of a lane's share of the slots 0, 1, 2, ...; all of them without lanes."""
    return (0, 1) if lane is None else (lane[0], lane[1])


@formula
def cuda_lane(place, neighbours):  # noqa: ANN001, ANN201
    """(particle, lane) of thread `place` in a kernel with `lanes`: that many neighbouring threads share a particle."""
    lanes = len(neighbours.lanes)
    return place // lanes, place % lanes


@formula
def cuda_share_row(columns, i, lane, lanes):  # noqa: ANN001, ANN201
    """(first, stride, count) of a lane's share of column i of any list, the walls', too."""
    n = columns.count.shape[0]
    count = (columns.count[i] + lanes - 1 - lane) // lanes
    return np.uint64(i + lane * n), np.uint64(lanes * n), np.uint64(count)
