"""Seconds of the clock and of the processors."""

import os
import time
from typing import NamedTuple


class Seconds(NamedTuple):
    """A reading of both clocks, or what lies between two [s].

    wall       of the clock
    processor  of this process in all its threads, and of its children that have ended
    """

    wall: float = 0.0
    processor: float = 0.0

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


_IMPORTED = Seconds.now()
PROCESS = Seconds(_IMPORTED.wall - _IMPORTED.processor)  # when this process began: until here one processor was at work
