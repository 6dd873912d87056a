"""The state of a run between two steps: fields, clock, and where the neighbour list was built.

The functions of this package take it as an argument; of its parts only a GPU's graphs hold it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from refsim.backends import arrays as backends
from refsim.backends.arrays import Backend, Scratch
from refsim.core.capabilities import LimitsSpeed, effects_with
from refsim.core.effect import Effect, Pass
from refsim.engine.binding import fused
from refsim.engine.limits import StepOutcome, step_limits
from refsim.engine.lists import Lists, Order
from refsim.engine.motions import Motions
from refsim.engine.timings import Timings
from refsim.neighbours import NeighbourSearch
from refsim.scene.plan import Plan
from refsim.smoothing import Smoothing
from refsim.sph import WAY

Calls = list[tuple[str, Callable[[], None]]]  # operation and its launch


@dataclass(frozen=True)
class StepResult:
    """One step: its number, the time [s] at its end, its length [s], the limit that set it, and all limits [s]."""

    step: int
    time: float
    length: float
    limiter: str
    limits: dict[str, float]


class State:
    """A plan's particles on a backend.

    fields            arrays of the backend by name, rows in the order of the memory
    shared            parameter groups, lists and walls that every pass may take, by name
    parameters        parameter groups of each effect
    time, steps       reached [s]
    previous_length   of the last step [s]; first_length that of the first one
    limiters          how many steps each limit has set
    stopped_at_walls  how often a wall's plane has stopped a particle
    remarks           those of the `notes` that were made during the run, by what made them
    build_position    (n, 3) [m] at the last build of the neighbour list
    extremes, displacement, timestep  see operations sph.extremes (7,) and sph.kick_drift (3,), and [s] (2,)
    current           fields that follow from the state and belong to the present one
    bound             whether the calls take the present arrays; `bindings` counts how often they were bound
    foreseen          whether the forces of the next step are launched
    own_forces        functions of the user's that add to the acceleration
    """

    source: Path | None = None  # the checkpoint that it was resumed from
    last: StepResult | None = None
    first_length: float | None = None
    start_calls: Calls
    begin_calls: Calls
    force_calls: list[tuple[str, bool, Callable[[], None]]]  # the second says whether it runs on demand only
    motion_calls: Calls
    extremes_call: Callable[[], None]

    def __init__(self, plan: Plan, backend: Backend, timings: Timings) -> None:
        grid, given = plan.grid, plan.state
        self.plan, self.backend, self.timings = plan, backend, timings
        self.fields = {
            name: backend.zeros(f.shape(grid.count), f.numpy_dtype(grid.dtype)) for name, f in plan.fields.items()
        }
        places = {"position": given.position, "velocity": given.velocity, "mass": given.mass}
        numbers = {name: np.arange(grid.count) for name in ("identity", "place") if name in self.fields}
        for name, values in (places | numbers | dict(given.values)).items():
            self.write_field(name, values)
        self.time, self.steps, self.previous_length, self.stopped_at_walls = 0.0, 0, 0.0, 0
        self.limiters: dict[str, int] = {}
        self.notes, self.remarks = list(plan.notes), dict[str, str]()
        self.extremes, self.displacement, self.timestep = (backend.zeros(n, grid.dtype) for n in (7, 3, 2))
        self.build_position = backend.asarray(self.host("position"))
        self.scratch = Scratch(backend)
        self.shared: dict[str, Any] = {**_placed(plan.shared, backend), "scratch": self.scratch}
        self.parameters = {effect: _placed(groups, backend) for effect, groups in plan.parameters.items()}
        self.motions = Motions(plan, backend, self.parameters, self.shared) if plan.scene.motion else None
        self.lists = Lists(plan, backend, self.shared)
        self.order = Order(plan, backend, self.parameters)
        self.force_passes: list[tuple[tuple[Effect, ...], Pass]] = fused(plan.passes, backend.name)
        self.limits = step_limits(plan)
        speeds = (effect.greatest_speed(grid) for effect in effects_with(plan.effects, LimitsSpeed))
        self.greatest_speed = min(speeds, default=math.inf)  # [m/s] beyond which the run is taken to have diverged
        self.needs: dict[str, frozenset[int]] = {}  # numbers of the passes on which a field depends, once asked for
        self.current: set[str] = set()
        self.bound, self.bindings, self.foreseen = False, 0, False
        self.own_forces: list[Callable[[float, Mapping[str, Any]], None]] = []

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.plan.grid.count

    @property
    def search(self) -> NeighbourSearch | None:
        """The neighbour search; None where no list is needed."""
        return self.lists.search

    def host(self, name: str) -> np.ndarray:
        """A copy of a field on the host, as it is on the backend."""
        return np.array(self.backend.host(self.fields[name]))

    def stored(self, name: str) -> np.ndarray:
        """A field's values as they are on the backend, in the particles' first order; positions in the scene."""
        values = self.host(name)
        if name == "position" and any(self.plan.grid.origin):
            values = self.plan.grid.absolute(values)
            values += self.host("position_residual") if "position_residual" in self.fields else 0.0
        if self.plan.fields[name].rows is not None:
            return self.lists.in_first_order(values) if name in ("wall_pressure", "wall_strain") else values
        return self.in_first_order(values)

    def in_first_order(self, rows: np.ndarray) -> np.ndarray:
        """Rows of the particles in their first order."""
        ordered = np.empty_like(rows)
        ordered[self.host("identity")] = rows
        return ordered

    def write_field(self, name: str, values: np.ndarray) -> None:
        """Copy values to a field, in the order of the memory; positions are places in the scene."""
        if name == "position":
            values = self.plan.grid.local(values)
            if "position_residual" in self.fields:
                self.backend.assign(self.fields["position_residual"], 0.0)
        self.backend.assign(self.fields[name], values.astype(self.fields[name].dtype))

    def tick(self, done: StepOutcome) -> None:
        """Count a step: the clock moves on, and what follows the time; no field belongs to the new state yet.

        Raises RunStopped where a motion has no finite value at the new time.
        """
        self.current.clear()
        self.lists.velocities_set, self.lists.ways_renewed = False, self.foreseen and WAY.name in self.fields
        self.lists.after_step(done)
        self.stopped_at_walls += done.stopped
        self.time += done.length
        if self.motions is not None:
            self.motions.move(self.time)
        self.steps += 1
        self.previous_length = done.length

    def outdate(self) -> None:
        """Note that the state is another one, or sorted anew: no field that follows from it belongs to it any more."""
        self.current.clear()
        self.foreseen = False

    def add_note(self, by: str, note: str) -> None:
        """Add a note to the run, once for each that makes one."""
        if by not in self.remarks:
            self.remarks[by] = note
            self.notes.append(note)


def _placed(values: Mapping[str, Any], backend: Backend) -> dict[str, Any]:
    """Parameter groups on the backend; a CPU's programs are compiled for the smoothing kernel."""
    cpu = backend.name == "cpu"
    return {
        name: backends.on_backend(v.fixed() if cpu and isinstance(v, Smoothing) else v, backend)
        for name, v in values.items()
    }
