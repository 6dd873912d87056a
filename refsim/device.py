"""Array moves on a CUDA device, and the few things that CuPy does: stable sort, compaction, largest count.

Under the CUDA simulator, and only there, NumPy stands in for CuPy; `refsim.backend.array_library` says which
one is used.
"""

from __future__ import annotations

import functools
import importlib
from typing import Any

import numpy as np

from refsim.backend import simulated
from refsim.compile import cuda, cuda_kernel


@functools.cache
def library() -> Any:
    """CuPy; NumPy in the simulator."""
    return importlib.import_module("numpy" if simulated() else "cupy")


def _seen(array: Any) -> Any:
    """A device array as the library's own, without a copy (the simulator copies)."""
    return array.copy_to_host() if simulated() else library().asarray(array)


def _wrapped(array: Any) -> Any:
    """One of the library's arrays as a device array on the default stream, without a copy and without waiting."""
    return cuda.to_device(array) if simulated() else cuda.as_cuda_array(array, sync=False).bind(0)


def empty(shape: Any, dtype: Any) -> Any:
    """A device array whose values are not set, out of the library's memory pool."""
    return _wrapped(library().empty(shape, dtype))


def free_bytes() -> float:
    """Device memory that could still be had [bytes]."""
    if not simulated():
        library().get_default_memory_pool().free_all_blocks()
    return cuda.current_context().get_memory_info()[0]


def stable_order(keys: Any) -> Any:
    """Permutation (n,) int64 that sorts the int64 `keys`; equal keys keep their order (radix sort)."""
    if not keys.shape[0]:
        return empty(0, np.int64)
    return _wrapped(library().argsort(_seen(keys), kind="stable"))


def runs(keys: Any) -> tuple[Any, Any, Any]:
    """Runs of equal `keys` (n,): (key of each run, first place of each run and n at the end, run of each place)."""
    xp = library()
    if not keys.shape[0]:
        return keys, _wrapped(xp.zeros(1, dtype=np.int64)), empty(0, np.int32)
    seen = _seen(keys)
    begins = xp.ones(len(seen), dtype=bool)
    begins[1:] = seen[1:] != seen[:-1]
    first = xp.flatnonzero(begins)
    run = xp.cumsum(begins, dtype=np.int32) - np.int32(1)
    ends = xp.append(first, xp.full(1, len(seen), dtype=first.dtype)).astype(np.int64)
    return _wrapped(seen[first]), _wrapped(ends), _wrapped(run.astype(np.int32))


def largest(values: Any) -> int:
    """Largest of the integer `values`, 0 if there are none."""
    return int(_seen(values).max()) if values.shape[0] else 0


@cuda_kernel
def fill_scalars(value, out):  # noqa: ANN001, ANN201  (types are Numba's)
    """out[i] = value."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        out[i] = value


@cuda_kernel
def fill_vectors(value, out):  # noqa: ANN001, ANN201
    """out[i, c] = value."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        for c in range(out.shape[1]):
            out[i, c] = value


@cuda_kernel
def gather_scalars(array, order, out):  # noqa: ANN001, ANN201
    """out[i] = array[order[i]]."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        out[i] = array[order[i]]


@cuda_kernel
def gather_vectors(array, order, out):  # noqa: ANN001, ANN201
    """out[i, c] = array[order[i], c]."""
    i = cuda.grid(1)
    if i < out.shape[0]:
        j = order[i]
        for c in range(out.shape[1]):
            out[i, c] = array[j, c]


def fill(out: Any, value: float) -> None:
    """Set every element of a device array of one or two dimensions to `value`."""
    (fill_scalars if len(out.shape) == 1 else fill_vectors)(out.dtype.type(value), out)


def gather(array: Any, order: Any, out: Any) -> None:
    """out <- array[order] for device arrays of one or two dimensions."""
    (gather_scalars if len(out.shape) == 1 else gather_vectors)(array, order, out)
