"""Copies and permutations of CUDA arrays, the clock of the step, CUDA graphs, and CuPy's stable sort and sums.

Under the CUDA simulator, and only there, NumPy stands in for CuPy.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from refsim.backends.compile import (
    THREADS_PER_BLOCK,
    cuda,
    cuda_formula,
    cuda_kernel,
    on_device,
    overloaded,
    row_kernel,
)
from refsim.backends.primitives import set_four, sum_before, sum_of_block
from refsim.backends.runtime import branch, cupy_or_numpy, on_branch, own_stream, simulated


def as_cupy(array: Any) -> Any:
    """A device array as the library's own, without a copy (the simulator copies)."""
    return array.copy_to_host() if simulated() else cupy_or_numpy().asarray(array)


def as_numba(array: Any) -> Any:
    """One of the library's arrays as a device array on the default stream, without a copy and without waiting."""
    if simulated():
        return cuda.to_device(array)
    # without the array's stream: looking it up, and a copy that is bound to the default one, take longer than a launch
    return cuda.from_cuda_array_interface(array.__cuda_array_interface__ | {"stream": None}, array, sync=False)


def empty(shape: Any, dtype: Any) -> Any:
    """A device array whose values are not set, out of the library's memory pool."""
    return as_numba(cupy_or_numpy().empty(shape, dtype))


def free_bytes() -> float:
    """Free device memory [bytes]."""
    if not simulated():
        cupy_or_numpy().get_default_memory_pool().free_all_blocks()
    return cuda.current_context().get_memory_info()[0]


def stable_order(keys: Any, out: Any = None) -> Any:
    """Permutation (n,) int64 that sorts the int64 `keys`; equal keys keep their order (radix sort)."""
    if not keys.shape[0]:
        return empty(0, np.int64) if out is None else out
    order = cupy_or_numpy().argsort(as_cupy(keys), kind="stable")
    if out is None:
        return as_numba(order)
    if simulated():
        out.copy_to_device(order)
    else:
        as_cupy(out)[...] = order
    return out


# Running sums by kernels only, so that they can be recorded: sums of tiles, then sums within tiles.
EACH = 8  # values that a thread adds up in a turn
MOST_TILES = 1024


@cuda_formula
def tile_of(values, totals):  # noqa: ANN001, ANN201
    """(first, end) of a thread block's tile of the `values`: as many turns of the block as are needed for all tiles."""
    turn = cuda.blockDim.x * EACH
    length = (values.shape[0] + turn * totals.shape[0] - 1) // (turn * totals.shape[0]) * turn
    first = min(cuda.blockIdx.x * length, values.shape[0])
    return first, min(first + length, values.shape[0])


@cuda_kernel(rows_of="totals", block_for_each_row=True)
def add_up_tiles(values, totals):  # noqa: ANN001, ANN201
    """totals[b] = sum of the int32 `values` of tile b."""
    first, end = tile_of(values, totals)
    total = 0
    for k in range(first + cuda.threadIdx.x, end, cuda.blockDim.x):
        total += values[k]
    total = sum_of_block(cuda.shared.array(THREADS_PER_BLOCK, np.int32), total)
    if cuda.threadIdx.x == 0:
        totals[cuda.blockIdx.x] = total


@cuda_kernel(rows_of="totals", block_for_each_row=True)
def add_up_within(values, totals, out):  # noqa: ANN001, ANN201
    """out[i] = values[0] + ... + values[i]; `totals` are the sums of the tiles."""
    shared = cuda.shared.array(THREADS_PER_BLOCK, np.int32)
    total = 0
    for k in range(cuda.threadIdx.x, cuda.blockIdx.x, cuda.blockDim.x):
        total += totals[k]
    before = sum_of_block(shared, total)
    begin, end = tile_of(values, totals)
    for at in range(begin, end, cuda.blockDim.x * EACH):
        first = at + cuda.threadIdx.x * EACH
        total = 0
        for k in range(first, min(first + EACH, end)):
            total += values[k]
        cuda.syncthreads()
        running = before + sum_before(shared, total)
        for k in range(first, min(first + EACH, end)):
            running += values[k]
            out[k] = running
        if at + cuda.blockDim.x * EACH < end:
            cuda.syncthreads()
            before += sum_of_block(shared, total)


def tiles(values: int) -> int:
    """Number of tiles of so many values."""
    turn = add_up_tiles.threads * EACH
    return min((values + turn - 1) // turn, MOST_TILES)


class RunningSum:
    """out[i] = values[0] + ... + values[i] for one pair of int32 arrays, as launches that can be recorded.

    totals  (tiles,) int32, scratch memory; by default its own
    """

    def __init__(self, values: Any, out: Any, totals: Any = None) -> None:
        self.values, self.out = values, out
        self.totals = empty(tiles(values.shape[0]), np.int32) if totals is None else totals

    def __call__(self) -> None:
        add_up_tiles(self.values, self.totals)
        add_up_within(self.values, self.totals, self.out)


_recording = False  # whether launches are being recorded as a graph


def launch_after(calls: Sequence[Callable[[], None]], after: Sequence[Sequence[int]]) -> None:
    """Launch calls one after the other; in a graph call k waits for the calls after[k] only, which stand before it.

    A call stands behind one that it waits for, or begins a branch of the graph.
    """
    if not _recording:
        for call in calls:
            call()
        return
    first, here = branch(), Event().set()
    ends: list[Event] = []
    tails: list[int] = []  # last call of each branch
    for k, call in enumerate(calls):
        number = next((b for b, last in enumerate(tails) if last in after[k]), len(tails))
        with on_branch(first + number):
            if number == len(tails):
                tails.append(-1)
                if number and not after[k]:
                    own_stream().wait_event(here.event)
            for before in after[k]:
                if before != tails[number]:
                    own_stream().wait_event(ends[before].event)
            call()
            tails[number] = k
            ends.append(Event().set())
    for last in tails[1:]:
        own_stream().wait_event(ends[last].event)


def side_by_side(*calls: Callable[[], None]) -> None:
    """Launch calls that need nothing of each other: in a graph as branches."""
    launch_after(calls, [()] * len(calls))


class CudaGraph:
    """A call that launches kernels only, as one CUDA graph: launched one by one at first, then recorded, then replayed.

    The launches must use the same arrays and numbers every time, allocate nothing and not wait for the device. In the
    simulator, or if `whole` is false, the kernels are launched one by one every time.
    """

    def __init__(self, call: Callable[[], None], whole: bool = True) -> None:
        self.call, self.whole = call, whole and not simulated()
        self.called = False
        self.graph: Any = None

    def __call__(self) -> None:
        if not self.whole or not self.called:
            self.call()  # the first time also compiles and loads, which cannot be recorded
            self.called = True
            return
        global _recording
        stream = own_stream()
        if self.graph is None:
            stream.begin_capture()
            _recording = True
            try:
                self.call()
            finally:
                _recording = False
                self.graph = stream.end_capture()
        self.graph.launch(stream)

    def renewed(self) -> "CudaGraph":
        """The same call after its arrays have been replaced: it is recorded again."""
        new = CudaGraph(self.call, self.whole)
        new.called = self.called
        return new


class PinnedCopy:
    """A small device array and a copy of it on the host, which `send` updates asynchronously."""

    def __init__(self, array: Any) -> None:
        self.array = array
        self.values = self.there = np.zeros(array.shape, array.dtype)
        if not simulated():
            memory = cupy_or_numpy().cuda.alloc_pinned_memory(self.values.nbytes)  # which kernels can write
            self.values = np.frombuffer(memory, array.dtype, self.values.size).reshape(array.shape)
            place = {"shape": array.shape, "typestr": array.dtype.str, "data": (memory.ptr, False), "version": 3}
            self.there = cuda.from_cuda_array_interface(place, memory, sync=False)

    def send(self) -> None:
        """Launch the copy; it can be recorded."""
        if simulated():
            self.values[...] = self.array.copy_to_host()
        else:
            copy(self.array, self.there)  # a kernel: it takes half as long as a copy of its own

    def read(self) -> np.ndarray:
        """Wait for all launches; the values at the time of `send`."""
        if not simulated():
            own_stream().synchronize()
        return self.values


class Event:
    """A CUDA event: a point in the sequence of launches that the host can wait for, or another branch of a graph."""

    def __init__(self) -> None:
        self.event = None if simulated() else cupy_or_numpy().cuda.Event(disable_timing=True)

    def set(self) -> "Event":
        """This event, recorded after all launches so far on the present branch."""
        if self.event is not None:
            self.event.record(own_stream())
        return self

    def wait(self) -> None:
        """Wait until the device has reached the event."""
        if self.event is not None:
            self.event.synchronize()


def head(array: Any, count: int) -> Any:
    """The first rows of a device array, without a copy."""
    return array[:count] if simulated() else as_numba(as_cupy(array)[:count])


def address(array: Any) -> Any:
    """Address of a device array's memory; in the simulator the identity of the array."""
    return id(array) if simulated() else array.device_ctypes_pointer.value


@row_kernel
def fill_scalars(i, value, out):  # noqa: ANN001, ANN201  (types are Numba's)
    """out[i] = value."""
    out[i] = value


def set_row(out, i, array, j):  # noqa: ANN001, ANN201
    """out[i] = array[j], of arrays of one dimension or of two."""
    out[i] = array[j]


def _set_row_of(out, i, array, j):  # noqa: ANN001, ANN202
    def set_vector(out, i, array, j):  # noqa: ANN001, ANN202
        if out.shape[1] == 3:  # all are read before one is written: the arrays might be the same memory
            x, y, z = array[j, 0], array[j, 1], array[j, 2]
            out[i, 0], out[i, 1], out[i, 2] = x, y, z
        else:
            for c in range(out.shape[1]):
                out[i, c] = array[j, c]

    return set_row if out.ndim == 1 else set_vector


overloaded(set_row, _set_row_of, forceinline=True)


@row_kernel(rows_of="order")
def gather_all(i, arrays, order, out):  # noqa: ANN001, ANN201
    """out[k] <- arrays[k][order] for tuples of arrays of one kind."""
    for k in range(len(arrays)):
        set_row(out[k], i, arrays[k], order[i])


@row_kernel(rows_of="first")
def copy_all(i, arrays, out, first):  # noqa: ANN001, ANN201
    """out[k] <- arrays[k] for tuples of arrays of one kind; `first` is one of them."""
    for k in range(len(arrays)):
        set_row(out[k], i, arrays[k], i)


@row_kernel(rows_of="first")
def pack_all(i, vectors, scalars, out, first):  # noqa: ANN001, ANN201
    """out[k][i] = (vectors[k][i], scalars[k][i]); `first` is the first of `out`."""
    for k in range(len(out)):
        set_four(out[k], i, vectors[k][i, 0], vectors[k][i, 1], vectors[k][i, 2], scalars[k][i])


# Rows of the clock, float64. REASON is 0 while the run can go on.
CLOCK_ROWS = 15
TIME, PREVIOUS, FIRST, LENGTH, LIMITER, REASON, SPEED, ACCELERATION, RATE, EXCESS, *_REST = range(CLOCK_ROWS)
DENSE, CRUSHED, WAY, STOPPED, SHIFTED = _REST
NON_FINITE, DIVERGED, STEP_TOO_SMALL, OUT_OF_RANGE, COMPRESSED = 1, 2, 3, 4, 5


@cuda_kernel
def choose_step(extremes, limits, factor, fixed, smallest, greatest_speed, most_crushed, timestep, clock):  # noqa: ANN001, ANN201
    """The next step's length from the particles' extremes, as `refsim.engine.stepping.advance` does on the host.

    `limits` (k, 5) are StepLimits. If the run cannot go on, the clock holds the reason and the step is zero, so that
    later kernels move nothing.
    """
    if cuda.grid(1) == 0:
        speed = math.sqrt(float(extremes[0]))
        acceleration = math.sqrt(float(extremes[1]))
        length, limiter = math.inf, 0
        for k in range(limits.shape[0]):
            rate = limits[k, 1] + limits[k, 2] * speed + limits[k, 3] * math.sqrt(limits[k, 0] * acceleration)
            rate += limits[k, 4] * float(extremes[3])
            if rate > 0.0 and limits[k, 0] / rate < length:
                length, limiter = limits[k, 0] / rate, k
        length *= factor
        if fixed > 0.0:
            length, limiter = fixed, -1
        if clock[FIRST] == 0.0:
            clock[FIRST] = length
        reason = 0
        if extremes[2] > 0:
            reason = NON_FINITE
        elif speed > greatest_speed:
            reason = DIVERGED
        elif extremes[4] > 0:
            reason = OUT_OF_RANGE
        elif extremes[6] > most_crushed:
            reason = COMPRESSED
        elif not length > smallest * clock[FIRST]:
            reason = STEP_TOO_SMALL
        clock[LENGTH], clock[LIMITER], clock[REASON] = length, limiter, reason
        clock[SPEED], clock[ACCELERATION] = speed, acceleration
        clock[RATE], clock[EXCESS] = float(extremes[3]), float(extremes[4])
        clock[DENSE], clock[CRUSHED] = float(extremes[5]), float(extremes[6])
        if reason:
            length = 0.0
        timestep[0] = 0.5 * (clock[PREVIOUS] + length) if length > 0.0 else 0.0
        timestep[1] = length
        if length > 0.0:
            clock[PREVIOUS] = length
            clock[TIME] += length


@row_kernel
def send_clock(k, displacement, clock, there):  # noqa: ANN001, ANN201
    """What `sph.kick_drift` reduces goes into the clock's last rows, the clock goes `there`."""
    if k >= WAY:
        clock[k] = displacement[k - WAY]
    there[k] = clock[k]


def copy(array: Any, out: Any) -> None:
    """out <- array for device arrays of one or two dimensions, by a kernel, so that it can be recorded."""
    copy_all((array,), (out,), out)


@row_kernel
def invert(i, order, places):  # noqa: ANN001, ANN201
    """places[order[i]] = i."""
    places[order[i]] = i


def fill(out: Any, value: float) -> None:
    """Set every element of a device array of one or two dimensions to `value`."""
    if value == 0 and not simulated() and on_device(out):  # the device's own way takes a quarter of a kernel's time
        size = out.size * out.dtype.itemsize
        cupy_or_numpy().cuda.runtime.memsetAsync(out.device_ctypes_pointer.value or 0, 0, size, own_stream().ptr)
        return
    fill_scalars(out.dtype.type(value), out if len(out.shape) == 1 else out.reshape(out.size))


def gather(array: Any, order: Any, out: Any) -> None:
    """out <- array[order] for device arrays of one or two dimensions."""
    gather_all((array,), order, (out,))


def packed(vectors: tuple, scalars: tuple, out: tuple) -> None:
    """out[k] (n, 4) <- vectors[k] (n, 3) with scalars[k] (n,) behind: a thread reads a row at once (`four_of`)."""
    pack_all(vectors, scalars, out, out[0])


class Rows:
    """Reorders the rows of arrays in place through spare arrays; arrays of equal shape and dtype in one launch."""

    def __init__(self, arrays: list[Any], order: Any) -> None:
        self.arrays, self.order = arrays, order
        kinds = dict.fromkeys((a.shape, a.dtype) for a in arrays)
        alike = [tuple(a for a in arrays if (a.shape, a.dtype) == kind) for kind in kinds]
        self.kinds = [(group, tuple(empty(a.shape, a.dtype) for a in group)) for group in alike]

    def belongs_to(self, arrays: list[Any]) -> bool:
        """Whether it reorders these arrays."""
        return len(arrays) == len(self.arrays) and all(a is b for a, b in zip(self.arrays, arrays, strict=True))

    def launch(self) -> None:
        """arrays[k] <- arrays[k][order]; it can be recorded."""
        side_by_side(*(partial(self._move, *kind) for kind in self.kinds))

    def _move(self, arrays: tuple, spare: tuple) -> None:
        gather_all(arrays, self.order, spare)
        copy_all(spare, arrays, spare[0])

    @property
    def nbytes(self) -> int:
        """Memory of the spare arrays."""
        return sum(a.nbytes for _, spare in self.kinds for a in spare)


def largest(values: Any) -> int:
    """Largest of the integer `values`, 0 if there are none; waits for the device."""
    return int(as_cupy(values).max()) if values.shape[0] else 0
