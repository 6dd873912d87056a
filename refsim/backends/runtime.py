"""The CUDA runtime: whether it is simulated, the library that sorts and scans arrays, the stream of all launches."""

from __future__ import annotations

import functools
import importlib
import os
from typing import Any


def simulated() -> bool:
    """Whether CUDA kernels run in Numba's CUDA simulator."""
    return os.environ.get("NUMBA_ENABLE_CUDASIM", "0") not in ("", "0")


def array_library() -> str:
    """Name of the library that sorts and compacts arrays for the CUDA backend: CuPy, or NumPy in the simulator."""
    return "NumPy in place of CuPy (CUDA simulator)" if simulated() else "CuPy"


@functools.cache
def library() -> Any:
    """CuPy; NumPy in the simulator."""
    return importlib.import_module("numpy" if simulated() else "cupy")


@functools.cache
def own_stream() -> Any:
    """CuPy's stream on which everything is launched, so that it can be recorded; None in the simulator.

    It synchronises with the default stream in both directions, so that copies need no explicit synchronisation.
    """
    return None if simulated() else library().cuda.Stream(non_blocking=False)


@functools.cache
def stream() -> Any:
    """The stream on which CUDA kernels are launched, as numba-cuda takes it."""
    if simulated():
        return 0
    from numba import cuda

    return cuda.external_stream(own_stream().ptr)
