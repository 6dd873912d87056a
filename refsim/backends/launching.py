"""Direct launches of compiled CUDA kernels, without Numba's search for the types of the arguments.

That search takes about 0.1 ms a launch, more than most kernels of a surface reconstruction run. A direct launch needs
private names of numba-cuda; if they are missing, kernels are launched through the public call
`dispatcher[blocks, threads, stream](*arguments)`.
"""

import ctypes
import functools
import warnings
from typing import Any

import numpy as np

from refsim.backends.fast.private import disable_private, lost, names
from refsim.backends.runtime import branch, stream

SCALARS = {
    bool: bool, int: ctypes.c_int64, float: ctypes.c_double, np.uint8: ctypes.c_uint8, np.int32: ctypes.c_int32,
    np.int64: ctypes.c_int64, np.float32: ctypes.c_float, np.float64: ctypes.c_double,
}  # fmt: skip
EARLY = "programmatic_stream_serialization"  # which only later versions of `cuda.core` know
_warned: list[str] = []


class Launch:
    """A compiled CUDA kernel for arguments of certain kinds (see `kinds_of`), launched directly."""

    def __init__(self, dispatcher: Any, arguments: tuple) -> None:
        from cuda.core import LaunchConfig, launch

        private: Any = names("launch")  # without them an AttributeError
        types = tuple(private.typeof(argument, private.Purpose.argument) for argument in arguments)
        self.kernel = dispatcher.overloads[types]._codelibrary.get_cufunc().kernel
        self.launch, self.config = launch, LaunchConfig
        self.stream_of = functools.cache(lambda number: private._to_core_stream(stream()))  # of the branch at work

    def __call__(self, blocks: int, threads: int, arguments: tuple, early: bool) -> None:
        values: list[Any] = []
        unfold(arguments, values)
        shape: dict[str, Any] = {"grid": (blocks, 1, 1), "block": (threads, 1, 1)}
        if early and hasattr(self.config, EARLY):
            shape[EARLY] = True
        self.launch(self.stream_of(branch()), self.config(**shape), self.kernel, *values)


def direct_launch(dispatcher: Any, arguments: tuple) -> Launch | None:
    """A direct launch of a kernel compiled for these arguments; None, with one warning, if it is impossible."""
    try:
        return Launch(dispatcher, arguments)
    except (AttributeError, ImportError, KeyError, TypeError) as error:
        disable_private("launch", str(error) or type(error).__name__)
        if not _warned:
            _warned.append(lost()["launch"])
            warnings.warn(_warned[0], stacklevel=3)
        return None


def kinds_of(values: tuple) -> tuple | None:
    """What a compiled kernel depends on in its arguments; None if `unfold` does not know the type of one of them."""
    kinds: list[Any] = [type(values)]
    for value in values:
        sort = type(value)
        if value is None or sort in SCALARS:
            kinds.append(sort)
        elif isinstance(value, tuple):
            inner = kinds_of(value)
            if inner is None:
                return None
            kinds.append(inner)
        elif hasattr(value, "copy_to_host") and value.is_c_contiguous():
            kinds.append((value.dtype.num, value.ndim))
        else:
            return None
    return tuple(kinds)


def unfold(arguments: tuple, values: list[Any]) -> None:
    """Append the numbers that a kernel takes for its arguments; seven and more for an array."""
    for value in arguments:
        sort = type(value)
        if value is None:
            values.append(0)
        elif sort in SCALARS:
            values.append(SCALARS[sort](value))
        elif isinstance(value, tuple):
            unfold(value, values)
        else:
            place = value.device_ctypes_pointer.value or 0
            values.extend((0, 0, value.size, value.dtype.itemsize, place, *value.shape, *value.strides))
