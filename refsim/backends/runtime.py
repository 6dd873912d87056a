"""The CUDA runtime: whether it is simulated, the library that sorts and scans arrays, the stream of all launches."""

import contextlib
import functools
import importlib
import os
from collections.abc import Iterator
from typing import Any

_branch = 0  # of the graph that is being recorded, on which kernels are launched


def simulated() -> bool:
    """Whether CUDA kernels run in Numba's CUDA simulator."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


@functools.cache
def cupy_or_numpy() -> Any:
    """CuPy; NumPy in the simulator."""
    return importlib.import_module("numpy" if simulated() else "cupy")


@functools.cache
def _stream_of(branch: int) -> Any:
    return None if simulated() else cupy_or_numpy().cuda.Stream(non_blocking=False)


def own_stream() -> Any:
    """CuPy's stream on which everything is launched, so that it can be recorded; None in the simulator.

    It synchronises with the default stream in both directions, so that copies need no explicit synchronisation.
    """
    return _stream_of(_branch)


@contextlib.contextmanager
def on_branch(branch: int) -> Iterator[None]:
    """Launch on the stream of a branch of the graph that is being recorded; 0 is the stream of all other launches."""
    global _branch
    before, _branch = _branch, branch
    try:
        yield
    finally:
        _branch = before


def branch() -> int:
    """The branch on which kernels are launched."""
    return _branch


@functools.cache
def _numba_stream_of(branch: int) -> Any:
    from numba import cuda

    return cuda.external_stream(_stream_of(branch).ptr)


def stream() -> Any:
    """The stream on which CUDA kernels are launched, as numba-cuda takes it."""
    return 0 if simulated() else _numba_stream_of(_branch)
