"""Scratch memory of operations; its contents are undefined after a call."""

from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend


class Scratch:
    """Named arrays on one backend, allocated at the first request and kept, so that later steps allocate nothing.

    An operation takes it as the argument `scratch`. The values in an array are those of its latest use.
    """

    def __init__(self, backend: Backend) -> None:
        self.backend = backend
        self._arrays: dict[str, Any] = {}
        self._packed: tuple[Any, ...] | None = None

    def unchanged(self, held: bool) -> None:
        """From now on positions and masses do not change, or they may."""
        self._packed = () if held else None

    def packs(self, fields: tuple[Any, ...]) -> bool:
        """Note that the first packed row holds these fields, positions and masses; whether it holds them already."""
        before = self._packed
        if before is None:
            return False
        self._packed = fields
        return len(fields) > 0 and len(before) == len(fields) and all(a is b for a, b in zip(before, fields))

    def array(self, name: str, shape: Any, dtype: Any) -> Any:
        """The array called `name`, of this shape and dtype; its values are not set."""
        shape = (shape,) if isinstance(shape, int) else tuple(shape)
        held = self._arrays.get(name)
        if held is None or tuple(held.shape) != shape or held.dtype != np.dtype(dtype):
            held = self._arrays[name] = self.backend.empty(shape, dtype)
        return held

    def called(self, name: str) -> Callable[[str, Any, Any], Any]:
        """`array` for the parts of what is called `name`."""
        return lambda part, shape, dtype: self.array(f"{name} {part}", shape, dtype)

    def host(self, array: Any) -> np.ndarray:
        """An array's values on the host."""
        return self.backend.host(array)

    @property
    def bytes(self) -> int:
        """Memory held."""
        return sum(a.nbytes for a in self._arrays.values())
