"""What the parts of the engine see of a run; `refsim.engine.simulation.Simulation` is one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np

from refsim.backends.arrays import Backend
from refsim.core.effect import Extremes, StepLimit
from refsim.scene.scene import Plan


class Run(Protocol):
    """A scene on a backend between two steps."""

    plan: Plan
    backend: Backend
    time: float  # [s]
    steps: int
    previous_length: float  # of the last step [s]
    first_length: float | None  # of the first step [s]
    greatest_speed: float  # [m/s] beyond which the run is taken to have diverged
    limits: dict[str, StepLimit]
    last: Any  # StepResult of the last step
    timings: Any  # seconds by stage
    fields: dict[str, Any]  # arrays of the backend by name
    build_position: Any  # (n, 3) [m] at the last build of the neighbour list
    extremes: Any  # (3,), see operation sph.extremes
    displacement: Any  # (2,), see operation sph.kick_drift
    timestep: Any  # (2,) [s]
    force_calls: Any
    begin_calls: Any
    motion_calls: Any
    extremes_call: Any
    _shared: dict[str, Any]

    def _host(self, name: str) -> np.ndarray: ...

    def evaluate(self, on_demand: bool = True) -> None: ...

    def launch(self, on_demand: bool) -> Iterator[tuple[str, tuple[str, ...]]]: ...

    def replay_passes(self, on_demand: bool = False) -> Iterator[tuple[str, tuple[str, ...]]]: ...

    def checked_extremes(self) -> Extremes: ...

    def step_limits(self, extremes: Extremes) -> dict[str, float]: ...
