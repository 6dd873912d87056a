"""The time loop over a plan, on one backend."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim import backend as backends
from refsim.boundary.walls import WallParticles, with_list
from refsim.checkpoint import Checkpoint, latest_checkpoint, read_checkpoint, write_checkpoint
from refsim.effect import Extremes
from refsim.errors import InputError, RunStopped
from refsim.neighbours import NeighbourSearch
from refsim.operation import REGISTRY
from refsim.scene import Plan, Scene, make_plan
from refsim.scene_file import check_same_scene, scene_from_checkpoint, scene_to_checkpoint
from refsim.versions import versions

SMALLEST_STEP = 1e-6  # share of the first step below which the run is taken to have diverged
MANY_FOR_ALL_PAIRS = 2000  # particles above which the numpy backend is announced as slow


@dataclass(frozen=True)
class StepResult:
    """One step: its length, who limited it, all limits, and why the run cannot go on (None if it can)."""

    step: int
    time: float
    length: float
    limiter: str
    limits: dict[str, float]
    reason: str | None = None


def stable_steps(plan: Plan, extremes: Extremes) -> dict[str, float]:
    """Largest stable steps [s] of a plan by what limits them, at these extremes."""
    grid, effects = plan.grid, plan.effects
    limits: dict[str, float] = {}
    if extremes.acceleration > 0:
        limits["force"] = 0.25 * math.sqrt(0.5 * grid.support_radius / extremes.acceleration)
    for effect in effects.values():
        limits |= effect.step_limits(grid, effects, extremes)
    if not limits:
        limits["resting"] = plan.scene.end_time or 1.0
    return limits


@dataclass
class Timings:
    """Wall seconds by stage; compile time is that of the first call of each program."""

    stages: dict[str, float] = field(default_factory=dict)
    first_calls: dict[str, float] = field(default_factory=dict)

    def add(self, stage: str, seconds: float) -> None:
        """Count a call; the first one of a stage is kept apart, because it may compile."""
        if stage in self.first_calls:
            self.stages[stage] = self.stages.get(stage, 0.0) + seconds
        else:
            self.first_calls[stage] = seconds


class Simulation:
    """A scene on a backend, step by step.

    scene    the scene, or a plan made from it
    backend  "numpy" (the references, all pairs), "cpu" or "cuda"; never swapped for another
    threads  CPU threads; all by default

    Raises InputError for bad input or a backend that is not there.
    """

    def __init__(self, scene: Scene | Plan, backend: str = "cpu", threads: int | None = None) -> None:
        self.plan = scene if isinstance(scene, Plan) else make_plan(scene)
        self.backend = backends.choose(backend)
        backends.set_threads(self.backend, threads)
        grid, state = self.plan.grid, self.plan.state
        n = grid.count
        self.time, self.steps, self.previous_length = 0.0, 0, 0.0
        self.first_length: float | None = None
        self.last: StepResult | None = None
        self.limiters: dict[str, int] = {}  # how many steps each limit has set
        self.notes: list[str] = []  # what a reader of the results must know
        if self.backend.name == "numpy" and n > MANY_FOR_ALL_PAIRS:
            self.notes.append(
                f"backend numpy computes all {n} x {n} pairs in each pass and is slow; it is meant for checks"
            )
        self.timings = Timings()
        self.fields = {
            name: self.backend.zeros(f.shape(n), f.numpy_dtype(grid.dtype)) for name, f in self.plan.fields.items()
        }
        self._set("position", state.position)
        self._set("velocity", state.velocity)
        self._set("mass", state.mass)
        self._set("identity", np.arange(n))
        self._extremes = self.backend.zeros(3, grid.dtype)
        self._displacement = self.backend.zeros(2, grid.dtype)
        self.stopped_at_walls = 0  # how often a wall's plane has stopped a particle
        self._timestep = self.backend.zeros(2, grid.dtype)
        self.build_position = self.backend.asarray(self._host("position"))
        self._squared_way = math.inf
        self._shared = {name: self._on_backend(value) for name, value in self.plan.shared.items()}
        self._parameters = {
            effect: {name: self._on_backend(value) for name, value in group.items()}
            for effect, group in self.plan.parameters.items()
        }
        self.search: NeighbourSearch | None = None
        self._static: Any = None
        self._wall_data: tuple[Any, Any] | None = None
        if self.plan.list_radius > 0 and self.backend.name != "numpy":
            self.search = NeighbourSearch(
                self.backend, grid.dim, grid.dtype, self.plan.list_radius, self.plan.scene.skin
            )
        self._prepare_walls()
        self._shared["neighbours"] = None
        self._calls: list[tuple[str, bool, Callable[[], None]]] = []
        self._bind()
        self._own = {
            name: self.backend.bind(REGISTRY[name], self._own_lookup) for name in ("sph.extremes", "sph.kick_drift")
        }

    # Reading the state

    def field(self, name: str) -> np.ndarray:
        """A field's values on the host, in the particles' first order (a copy)."""
        values = self._host(name)
        ordered = np.empty_like(values)
        ordered[self._host("identity")] = values
        return ordered

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.plan.grid.count

    # Advancing

    def evaluate(self, on_demand: bool = True) -> None:
        """Run the passes on the present state, so that every field belongs to it; the run is not changed by it."""
        for _ in self.replay_passes(on_demand):
            pass

    def replay_passes(self, on_demand: bool = False) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Run the passes on the present state one by one; after each, its operation and the fields it wrote.

        What outlives the step (warm starts, say) is put back at the end, so that the run is not changed.
        """
        self._update_list()
        written = {name for _, p in self.plan.passes for name in (*p.writes, *p.updates)}
        kept = {name: self._host(name) for name, f in self.plan.fields.items() if f.state and name in written}
        try:
            yield from self._launch(on_demand)
        finally:
            for name, values in kept.items():
                self.backend.assign(self.fields[name], values)

    def step(self) -> StepResult:
        """Advance by one stable step. Raises RunStopped, with the state as it was, where that is impossible."""
        self._update_list()
        for _ in self._launch(on_demand=False):
            pass
        began = time.perf_counter()
        limits = self.step_limits(self._checked_extremes())
        limiter = min(limits, key=lambda k: limits[k])
        length = float(limits[limiter] * self.plan.scene.step_factor)
        if self.plan.scene.step > 0:
            length, limiter = self.plan.scene.step, "fixed"
        if self.first_length is None:
            self.first_length = length
        if not length > SMALLEST_STEP * self.first_length:
            raise RunStopped(
                "step_too_small",
                f"In step {self.steps} at {self.time:.6g} s the {limiter} limit asks for a step of {length:.3g} s,"
                f" below {SMALLEST_STEP:g} of the first one: the run diverges.",
            )
        self.backend.assign(
            self._timestep,
            np.array([0.5 * (self.previous_length + length), length], dtype=self.plan.grid.dtype),
        )
        self._own["sph.kick_drift"]()
        self._squared_way, stopped = (float(x) for x in self.backend.host(self._displacement))
        self.stopped_at_walls += int(stopped)
        self.time += length
        self.steps += 1
        self.previous_length = length
        if not math.isfinite(self._squared_way):
            raise RunStopped(
                "non_finite",
                f"Step {self.steps} to {self.time:.6g} s moved a particle to a place that is not finite.",
            )
        self.timings.add("sph.kick_drift", time.perf_counter() - began)
        self.limiters[limiter] = self.limiters.get(limiter, 0) + 1
        self.last = StepResult(self.steps, self.time, length, limiter, limits)
        return self.last

    def step_limits(self, extremes: Extremes) -> dict[str, float]:
        """Largest stable steps [s] by what limits them."""
        return stable_steps(self.plan, extremes)

    # Stopping and going on

    def checkpoint(self, path: str | os.PathLike[str], keep: int = 2) -> None:
        """Write a checkpoint from which `resume` goes on bit for bit; the run is not changed by it.

        keep  whole checkpoints to hold (see `refsim.checkpoint.write_checkpoint`, also for the errors)

        Raises RunStopped, before the last good checkpoint is touched, where the state or the forces on it are
        not finite.
        """
        self.evaluate(on_demand=False)
        self._checked_extremes()
        snapshot = self.snapshot()
        write_checkpoint(path, snapshot.arrays, snapshot.attributes, keep)

    def snapshot(self) -> Checkpoint:
        """All that outlives a step, on the host: what a checkpoint file holds."""
        text, arrays = scene_to_checkpoint(self.plan)
        arrays |= {f"field.{name}": self._host(name) for name, f in self.plan.fields.items() if f.state}
        arrays["build_position"] = np.array(self.backend.host(self.build_position))
        attributes: dict[str, Any] = {
            "scene": text,
            "backend": self.backend.name,
            "versions": json.dumps(versions()),
            "time": self.time,
            "steps": self.steps,
            "previous_length": self.previous_length,
            "squared_way": self._squared_way,
            "list_built": self._shared["neighbours"] is not None,
            "limiters": json.dumps(self.limiters),
            "stopped_at_walls": self.stopped_at_walls,
        }
        if self.first_length is not None:
            attributes["first_length"] = self.first_length
        if self.search is not None:
            attributes["search_log"] = json.dumps(dataclasses.asdict(self.search.log))
        return Checkpoint(arrays, attributes)

    @classmethod
    def resume(
        cls,
        path: str | os.PathLike[str],
        backend: str | None = None,
        threads: int | None = None,
        scene: Scene | None = None,
    ) -> Simulation:
        """The simulation as it was when the checkpoint was written.

        path     a checkpoint, or a folder, of which the newest whole checkpoint is taken
        backend  that of the checkpoint by default; on it the run goes on bit for bit. Another one is allowed,
                 and `notes` then says that the numbers differ by rounding
        scene    where given, it must be the checkpoint's but for end_time and name, which are taken from it

        Raises InputError where the checkpoint cannot be read or does not fit the scene.
        """
        file = path
        if os.path.isdir(path):
            file = latest_checkpoint(path)
            if file is None:
                raise InputError(f"folder {path} holds no whole checkpoint; give the folder of a run, or a checkpoint.")
        saved = read_checkpoint(file)
        try:
            stored = scene_from_checkpoint(saved, str(file))
            plan = make_plan(stored)
            if scene is not None:
                plan = check_same_scene(scene, plan, str(file))
            simulation = cls(plan, backend or saved.attributes["backend"], threads)
            simulation._restore(saved, str(file))
        except KeyError as error:
            raise InputError(
                f"checkpoint {file} lacks {error}, so that it is not one of a run of this refsim; start the run again."
            ) from error
        return simulation

    def _restore(self, saved: Checkpoint, source: str) -> None:
        values = saved.attributes
        for name, f in self.plan.fields.items():
            if f.state:
                self._put(name, self.fields[name], saved.arrays[f"field.{name}"], source)
        self._put("build_position", self.build_position, saved.arrays["build_position"], source)
        self.time, self.steps = values["time"], values["steps"]
        self.previous_length, self.first_length = values["previous_length"], values.get("first_length")
        self.limiters = json.loads(values["limiters"])
        self.stopped_at_walls = values["stopped_at_walls"]
        if self.search is not None and values["list_built"]:
            self.rebuild_list()
            self._squared_way = values["squared_way"]
            here = self.search.log.list_bytes  # the room that the list has grown to changes no result
            for name, value in json.loads(values["search_log"]).items():
                setattr(self.search.log, name, value)
            self.search.log.list_bytes = here
        now, then = versions(), json.loads(values["versions"])
        if values["backend"] != self.backend.name:
            self.notes.append(
                f"resumed on backend {self.backend.name} from a checkpoint of backend {values['backend']}: the run goes"
                " on from the same state, but not bit for bit as it would have there"
            )
        elif now != then:
            changed = ", ".join(
                f"{name} {then.get(name)} -> {now[name]}" for name in now if now[name] != then.get(name)
            )
            self.notes.append(f"resumed with other versions ({changed}): bit for bit equality is not promised")

    def _put(self, name: str, target: Any, values: np.ndarray, source: str) -> None:
        if values.shape != target.shape or values.dtype != target.dtype:
            raise InputError(
                f"checkpoint {source}: {name} is {values.dtype} {values.shape}, and the scene wants {target.dtype}"
                f" {target.shape}; start the run again."
            )
        self.backend.assign(target, values)

    # Inside

    def _checked_extremes(self) -> Extremes:
        """Largest speed and acceleration. Raises RunStopped where one is not finite or the run has diverged."""
        self._own["sph.extremes"]()
        speed2, force2, broken = (float(x) for x in self.backend.host(self._extremes))
        if broken:
            raise RunStopped(
                "non_finite",
                f"In step {self.steps} at {self.time:.6g} s {int(broken)} particles have a velocity or an"
                " acceleration that is not finite.",
            )
        extremes = Extremes(math.sqrt(speed2), math.sqrt(force2))
        allowed = min((e.greatest_speed(self.plan.grid) for e in self.plan.effects.values()), default=math.inf)
        if extremes.speed > allowed:
            raise RunStopped(
                "diverged",
                f"In step {self.steps} at {self.time:.6g} s a particle moves with {extremes.speed:.4g} m/s, beyond the"
                f" {allowed:.4g} m/s up to which the scene's equations hold:"
                " take a smaller step or a larger sound speed.",
            )
        return extremes

    def _launch(self, on_demand: bool) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Launch the passes, in order; after each, its operation and the fields it wrote."""
        self.backend.assign(self.fields["acceleration"], 0.0)
        for (name, rare, call), (_, p) in zip(self._calls, self.plan.passes):
            if on_demand or not rare:
                began = time.perf_counter()
                call()
                self.timings.add(name, time.perf_counter() - began)
                yield name, (*p.writes, *p.updates)

    def _host(self, name: str) -> np.ndarray:
        return np.array(self.backend.host(self.fields[name]))

    def _set(self, name: str, values: np.ndarray) -> None:
        self.backend.assign(self.fields[name], values.astype(self.fields[name].dtype))

    def _on_backend(self, value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return self.backend.asarray(value)
        if isinstance(value, tuple) and any(isinstance(part, np.ndarray) for part in value):
            return type(value)(*(self._on_backend(part) for part in value))
        return value

    def _prepare_walls(self) -> None:
        walls = self.plan.walls
        if walls is None:
            return
        dtype = self.plan.grid.dtype
        if self.search is None:
            self._shared["walls"] = WallParticles(walls.position.astype(dtype), walls.volume.astype(dtype))
            return
        self._static = self.search.static_set(walls.position)
        volume = self.backend.asarray(walls.volume[self._static.order].astype(dtype))
        self._wall_data = (self._static.position, volume)

    def _update_list(self) -> None:
        """Build the list anew where a particle may have left its skin; the particles are put into cell order."""
        search = self.search
        if search is None or self._squared_way <= search.allowed_way**2:
            return
        began = time.perf_counter()
        if self._shared["neighbours"] is not None:
            search.audit(
                self.fields["position"],
                self.fields["velocity"],
                self.previous_length,
                self._shared["neighbours"],
                self.steps,
                self._shared.get("bounds"),
            )
            missed = search.log.missed_neighbours
            if missed:
                raise RunStopped(
                    "missed_neighbours",
                    f"The neighbour list lacked {missed} neighbours of the audited particles up to step {self.steps} at"
                    f" {self.time:.6g} s; give the scene a larger skin than {self.plan.scene.skin}.",
                )
        order = search.order(self.fields["position"])
        for name, f in self.plan.fields.items():
            if f.state:
                self.fields[name] = search.reorder(self.fields[name], order)
        self.backend.assign(self.build_position, self.fields["position"])
        self.rebuild_list()
        self.timings.add("neighbours", time.perf_counter() - began)

    def rebuild_list(self) -> None:
        """Build the list from the particles' present order and `build_position`."""
        assert self.search is not None
        self._shared["neighbours"] = self.search.build(self.build_position)
        if self._wall_data is not None:
            listed = self.search.build_against(self.build_position, self._static)
            self._shared["walls"] = with_list(*self._wall_data, listed)
        self._squared_way = 0.0
        self._bind()

    def _bind(self) -> None:
        self._calls = []
        for effect, p in self.plan.passes:
            operation = REGISTRY[p.operation]
            own = self._parameters[effect.name]

            def lookup(name: str, own: dict = own, p: Any = p, operation: Any = operation) -> Any:
                name = p.names.get(name, name)
                for source in (own, self._shared, self.fields):
                    if name in source:
                        return source[name]
                if name is None or name in operation.optional:
                    return None
                raise KeyError(f"{operation.name} takes {name!r}, which no effect of the scene provides")

            self._calls.append((operation.name, p.on_demand, self.backend.bind(operation, lookup)))
        self._own = {
            name: self.backend.bind(REGISTRY[name], self._own_lookup) for name in ("sph.extremes", "sph.kick_drift")
        }

    def _own_lookup(self, name: str) -> Any:
        own = {
            "extremes": self._extremes,
            "displacement": self._displacement,
            "timestep": self._timestep,
            "build_position": self.build_position,
            "bounds": self._shared.get("bounds"),
        }
        return own[name] if name in own else self.fields[name]
