"""Arrays of other libraries: NumPy's, those with `__dlpack__`, and those with `__cuda_array_interface__`."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

import numpy as np

CPU = 1  # device types of DLPack


def to_numpy(values: Any) -> np.ndarray | None:
    """A copy as a NumPy array on the host; None for what is no array.

    Accepted are NumPy arrays, arrays on a GPU with `__cuda_array_interface__` (CuPy, Torch, Warp, Numba), and arrays in
    host memory with `__dlpack__` (Torch, JAX, Warp, CuPy's on the host).
    """
    if isinstance(values, np.ndarray):
        return np.array(values)
    if hasattr(values, "__cuda_array_interface__"):
        from numba import cuda

        return cuda.as_cuda_array(values).copy_to_host()
    if hasattr(values, "__dlpack__") and int(values.__dlpack_device__()[0]) == CPU:
        return np.array(np.from_dlpack(values))
    return None


def converted(given: Mapping[str, Any], names: Collection[str], convert: Callable[[Any], Any]) -> dict[str, Any]:
    """The arguments of these names with `convert` applied to each array in them, those of groups included."""
    return {name: _converted(given[name], convert) for name in names}


def _converted(value: Any, convert: Callable[[Any], Any]) -> Any:
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return type(value)(*(_converted(part, convert) for part in value))
    return convert(value) if np.ndim(value) or hasattr(value, "copy_to_host") else value
