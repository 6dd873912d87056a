"""Wall seconds of a run by stage.

A stage is a pass, or a part of the loop: "neighbours", "sorting", "frames" (their fields), "writing" (of frames),
"checkpoints", "energy_audit".
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple


class StageCost(NamedTuple):
    """What one stage of a run took.

    stage     operation of the pass, or part of the loop
    seconds   of all launches; without the first one, where that may compile
    share     of `seconds` in the sum over all stages
    launches  number of launches, the first one included
    first     seconds of the first launch, where that may compile
    """

    stage: str
    seconds: float
    share: float
    launches: int
    first: float


@dataclass
class Timings:
    """Wall seconds by stage; the first call of a program, which may compile it, is counted apart.

    wait  of a run that is profiled: waits until everything launched has run, after every stage. Without it a stage on
          a GPU takes as long as its launch
    """

    stages: dict[str, float] = field(default_factory=dict)
    first_calls: dict[str, float] = field(default_factory=dict)
    launches: dict[str, int] = field(default_factory=dict)
    wait: Callable[[], None] | None = None
    counted: float = 0.0  # seconds of all stages, first calls included

    def add(self, stage: str, seconds: float) -> None:
        """Count a call of a program; the first one of a stage is kept apart, because it may compile."""
        if stage in self.first_calls:
            self.stages[stage] = self.stages.get(stage, 0.0) + seconds
        else:
            self.first_calls[stage] = seconds
        self.launches[stage] = self.launches.get(stage, 0) + 1
        self.counted += seconds

    def run(self, stage: str, call: Callable[[], None]) -> None:
        """Call a program and count it."""
        began = time.perf_counter()
        call()
        if self.wait is not None:
            self.wait()
        self.add(stage, time.perf_counter() - began)

    @contextmanager
    def of_host(self, stage: str) -> Iterator[None]:
        """Count the host's own work inside, which compiles nothing, less the stages that are counted meanwhile."""
        began, before = time.perf_counter(), self.counted
        yield
        own = time.perf_counter() - began - (self.counted - before)
        self.stages[stage] = self.stages.get(stage, 0.0) + own
        self.launches[stage] = self.launches.get(stage, 0) + 1
        self.counted += own

    def costs(self, elapsed: float) -> list[StageCost]:
        """Every stage, the longest first; "other" is what is left of the `elapsed` seconds."""
        seconds = {stage: self.stages.get(stage, 0.0) for stage in self.launches}
        seconds["other"] = max(elapsed - self.counted, 0.0)
        whole = sum(seconds.values()) or 1.0
        return [
            StageCost(stage, own, own / whole, self.launches.get(stage, 0), self.first_calls.get(stage, 0.0))
            for stage, own in sorted(seconds.items(), key=lambda item: -item[1])
        ]
