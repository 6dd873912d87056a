"""Seconds of a run: start, compiling, steps and writing, which add up to the whole, and wall seconds by stage.

A stage is a pass, or a part of the loop: "neighbours", "sorting", "frames" (their fields), "writing" (of frames),
"checkpoints".
"""

import functools
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from refsim.core.clock import Compiling, Seconds

WRITING = ("frames", "writing", "checkpoints")  # the stages of the part "writing"


class StageCost(NamedTuple):
    """What one stage of a run took."""

    stage: str  # operation of the pass, or part of the loop
    seconds: float  # of all launches; without the first one, where that may compile
    share: float  # of `seconds` in the sum over all stages
    launches: int  # number of launches, the first one included
    first: float  # seconds of the first launch, where that may compile, and of compiling in later ones


@dataclass
class Timings:
    """Seconds by part, and wall seconds by stage; what compiles, the first call or in a later one, is counted apart.

    compiles  whether first calls belong to the part "compiling"
    wait  of a run that is profiled: waits until everything launched has run, after every stage. Without it a stage on
          a GPU takes as long as its launch
    """

    compiles: bool = True
    began: Seconds = field(default_factory=Seconds.now)
    parts: dict[str, Seconds] = field(default_factory=dict)  # all but "steps", which is what is left
    stages: dict[str, float] = field(default_factory=dict)
    first_calls: dict[str, float] = field(default_factory=dict)
    launches: dict[str, int] = field(default_factory=dict)
    wait: Callable[[], None] | None = None
    counted: float = 0.0  # seconds of all stages, first calls included

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Count what happens inside for a part, less what is counted for others meanwhile."""
        began, before = Seconds.now(), self._parted()
        try:
            yield
        finally:
            seconds = Seconds.now().less(began).less(self._parted().less(before))
            self.parts[name] = self.parts.get(name, Seconds()).plus(seconds)

    def begin_steps(self) -> None:
        """What was not counted until the first call of this is the part "start"."""
        if "start" not in self.parts:
            self.parts["start"] = Seconds.now().less(self.began).less(self._parted())

    def account(self) -> dict[str, Any]:
        """Wall seconds of start, compiling, steps and writing, and their sum, total; in `processor` the same again."""
        whole, names = Seconds.now().less(self.began), ("start", "compiling", "steps", "writing")
        parts = self.parts | {"steps" if "start" in self.parts else "start": whole.less(self._parted())}
        by_part = {name: parts.get(name, Seconds()) for name in names} | {"total": whole}
        return {name: s.wall for name, s in by_part.items()} | {
            "processor": {n: s.processor for n, s in by_part.items()}
        }

    def _parted(self) -> Seconds:
        return functools.reduce(Seconds.plus, self.parts.values(), Seconds())

    def add(self, stage: str, seconds: float, compiling: float = 0.0) -> None:
        """Count a call of a program; the first one of a stage is kept apart, and what later ones compile."""
        if stage in self.first_calls:
            self.first_calls[stage] += compiling
            self.stages[stage] = self.stages.get(stage, 0.0) + seconds - compiling
        else:
            self.first_calls[stage] = seconds
        self.launches[stage] = self.launches.get(stage, 0) + 1
        self.counted += seconds

    def run(self, stage: str, call: Callable[[], None]) -> None:
        """Call a program and count it."""
        if self.compiles and stage not in self.first_calls:
            with self.part("compiling"):
                self._run(stage, call)
        else:
            self._run(stage, call)

    def _run(self, stage: str, call: Callable[[], None]) -> None:
        began, before, later = time.perf_counter(), Compiling.taken, stage in self.first_calls
        call()
        if self.wait is not None:
            self.wait()
        compiling = Compiling.taken.wall - before.wall
        self.add(stage, time.perf_counter() - began, compiling)
        if later and compiling:
            self.parts["compiling"] = self.parts.get("compiling", Seconds()).plus(Compiling.taken.less(before))

    @contextmanager
    def of_host(self, stage: str) -> Iterator[None]:
        """Count the host's own work inside, which compiles nothing, less the stages that are counted meanwhile."""
        began, before = time.perf_counter(), self.counted
        with self.part("writing") if stage in WRITING else nullcontext():
            yield
        seconds = time.perf_counter() - began - (self.counted - before)
        self.stages[stage] = self.stages.get(stage, 0.0) + seconds
        self.launches[stage] = self.launches.get(stage, 0) + 1
        self.counted += seconds

    def costs(self, elapsed: float) -> list[StageCost]:
        """Every stage, the longest first; "other" is what is left of the `elapsed` seconds."""
        seconds = {stage: self.stages.get(stage, 0.0) for stage in self.launches}
        seconds["other"] = max(elapsed - self.counted, 0.0)
        whole = sum(seconds.values()) or 1.0
        return [
            StageCost(stage, took, took / whole, self.launches.get(stage, 0), self.first_calls.get(stage, 0.0))
            for stage, took in sorted(seconds.items(), key=lambda item: -item[1])
        ]
