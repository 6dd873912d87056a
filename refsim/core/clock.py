"""Seconds of the clock and of the processors."""

import os
import time
from typing import NamedTuple


class Seconds(NamedTuple):
    """A reading of both clocks, or what lies between two [s]."""

    wall: float = 0.0  # of the clock
    processor: float = 0.0  # of this process in all its threads, and of its children that have ended

    @classmethod
    def now(cls) -> "Seconds":
        """The reading of this moment."""
        children = os.times()
        return cls(time.perf_counter(), time.process_time() + children.children_user + children.children_system)

    def less(self, other: "Seconds") -> "Seconds":
        """The difference."""
        return Seconds(self.wall - other.wall, self.processor - other.processor)

    def plus(self, other: "Seconds") -> "Seconds":
        """The sum."""
        return Seconds(self.wall + other.wall, self.processor + other.processor)


class Compiling:
    """What this process took so far to compile kernels and to load them: Numba tells when it begins and ends."""

    taken = Seconds()  # of the calls that have ended
    _depth, _began = 0, Seconds()

    @classmethod
    def begin(cls, *event: object) -> None:
        """Count from now on; one kernel's compiling may hold another's."""
        cls._depth += 1
        if cls._depth == 1:
            cls._began = Seconds.now()

    @classmethod
    def end(cls, *event: object) -> None:
        """Count until now."""
        cls._depth -= 1
        if cls._depth == 0:
            cls.taken = cls.taken.plus(Seconds.now().less(cls._began))


_IMPORTED = Seconds.now()
PROCESS = Seconds(_IMPORTED.wall - _IMPORTED.processor)  # when this process began: until here one processor was at work
