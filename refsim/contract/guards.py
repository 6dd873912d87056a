"""What a program under test may not touch: its inputs, and the bytes around every array that it is given."""

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from refsim.backends.arrays import Backend

GUARD_BYTES = 4096  # before and after each array on the CPU; a multiple of every alignment
PATTERN = 0xA5


class Guards:
    """Hands the arguments of one call over, and says afterwards what the program changed that is not its own.

    A program may change its outputs and what is named in `work`. On the CPU each array is a copy between guard bytes.
    On a GPU the inputs are compared, without guard bytes.
    """

    def __init__(self, backend: Backend, work: Collection[str] = ()) -> None:
        self.backend, self.work = backend, work
        self.checks: list[Callable[[], str]] = []

    def hold(self, name: str, value: Any, written: bool = False) -> Any:
        """The argument as the program gets it; arrays in named tuples are held, too, other objects are not.

        written  the argument is an output, which the program may change
        """
        written = written or name in self.work
        if isinstance(value, np.ndarray) and self.backend.name != "cuda":
            return self._fenced(name, value, written)
        if hasattr(value, "copy_to_host"):
            if not written:
                self._compared(name, value)
            return value
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            parts = zip(value._fields, value)
            return type(value)(*(self.hold(f"{name}.{field}", part, written) for field, part in parts))
        return value

    def faults(self) -> list[str]:
        """What the program did to arguments since, one clause for each."""
        return [fault for check in self.checks if (fault := check())]

    def _fenced(self, name: str, values: np.ndarray, written: bool) -> np.ndarray:
        memory = np.full(values.nbytes + 2 * GUARD_BYTES, PATTERN, np.uint8)
        array = np.ndarray(values.shape, values.dtype, memory, GUARD_BYTES)
        array[...] = values
        before = None if written else memory.copy()

        def check() -> str:
            fences = memory[:GUARD_BYTES], memory[GUARD_BYTES + values.nbytes :]
            for fence, where in zip(fences, ("before the start", "behind the end")):
                if (fence != PATTERN).any():
                    return f"it wrote {where} of {name}"
            return "" if before is None else _difference(name, before, memory, values, GUARD_BYTES)

        self.checks.append(check)
        return array

    def _compared(self, name: str, array: Any) -> None:
        before = np.array(self.backend.host(array))

        def check() -> str:
            after = np.array(self.backend.host(array))
            fault = _difference(name, _raw(before), _raw(after), before, 0)
            if fault:
                array.copy_to_device(before)  # lists serve several trials
            return fault

        self.checks.append(check)


def _raw(values: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(values).reshape(-1).view(np.uint8)


def _difference(name: str, before: np.ndarray, after: np.ndarray, values: np.ndarray, start: int) -> str:
    changed = np.flatnonzero(before != after)
    if not len(changed):
        return ""
    row = (int(changed[0]) - start) // max(values[:1].nbytes, 1) if values.ndim else 0
    return f"it changed its input {name} (row {row} first)"
