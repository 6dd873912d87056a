"""What the parts of the engine see of a run; `refsim.engine.simulation.Simulation` is one."""

from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.effect import Effect, Extremes, Pass, StepLimit
from refsim.engine.timings import Timings
from refsim.scene.plan import Plan

Calls = list[tuple[str, Callable[[], None]]]  # operation and its launch


class Run(Protocol):
    """A scene on a backend between two steps."""

    plan: Plan
    backend: Backend
    source: Path | None  # the checkpoint that it was resumed from
    time: float  # [s]
    steps: int
    previous_length: float  # of the last step [s]
    first_length: float | None  # of the first step [s]
    greatest_speed: float  # [m/s] beyond which the run is taken to have diverged
    limits: dict[str, StepLimit]
    limiters: dict[str, int]  # how many steps each limit has set
    stopped_at_walls: int  # how often a wall's plane has stopped a particle
    notes: list[str]
    remarks: dict[str, str]  # the notes that effects have made during the run, by effect
    last: Any  # StepResult of the last step
    timings: Timings
    fields: dict[str, Any]  # arrays of the backend by name
    build_position: Any  # (n, 3) [m] at the last build of the neighbour list
    extremes: Any  # (7,), see operation sph.extremes
    displacement: Any  # (2,), see operation sph.kick_drift
    timestep: Any  # (2,) [s]
    begin_calls: Calls
    force_calls: list[tuple[str, bool, Callable[[], None]]]  # the second says whether it runs on demand only
    motion_calls: Calls
    extremes_call: Callable[[], None]
    force_passes: list[tuple[tuple[Effect, ...], Pass]]  # of the force calls, with their effects
    lists: Any  # NeighbourLists
    order: Any  # ParticleOrder
    stepper: Any  # HostStepper or DeviceStepper
    auditor: Any  # Auditor, or None
    balances: Any  # Balances
    counting: Any  # Counting
    gauges: Any  # Gauges, or None
    motions: Any  # Motions, or None
    scratch: Any  # Scratch
    _shared: dict[str, Any]
    _parameters: dict[str, dict[str, Any]]

    def _host(self, name: str) -> np.ndarray: ...

    def start(self) -> None: ...

    def rebind(self) -> None: ...

    def remark(self, effect: str, note: str) -> None: ...

    def refresh(self, on_demand: bool = False) -> None: ...

    def outdate(self) -> None: ...

    def bring(self, names: Sequence[str]) -> None: ...

    def launch(self) -> Iterator[tuple[str, tuple[str, ...]]]: ...

    def replay_passes(self, on_demand: bool = False) -> Generator[tuple[str, tuple[str, ...]], None, None]: ...

    def checked_extremes(self) -> Extremes: ...
