"""The time loop over a plan, on one backend."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from refsim.backends import arrays as backends
from refsim.backends.scratch import Scratch
from refsim.core.effect import Effect, Extremes, Pass, StepLimit
from refsim.core.errors import InputError, RunStopped
from refsim.core.operation import PROCEDURES, REGISTRY, Current, backend_of
from refsim.core.reading import GREATEST
from refsim.core.versions import versions
from refsim.core.walls import WallParticles, with_list
from refsim.engine.audit import Auditor, AuditState
from refsim.engine.stepping import DeviceStepper, HostStepper, check_extremes, stable_steps
from refsim.io.checkpoint import Checkpoint, whole_checkpoint, write_checkpoint
from refsim.io.scenes import check_same_scene, scene_from_checkpoint, scene_to_checkpoint
from refsim.neighbours import NeighbourSearch, SearchLog
from refsim.scene.files import suggestion
from refsim.scene.scene import Plan, Scene, make_plan

WORTH_KEEPING = 0.2  # share of the allowed way below which the list is built anew rather than looked at in every step
SORT_EVERY = 50  # steps between two sortings of particles that no neighbour list sorts
MANY_FOR_ALL_PAIRS = 2000  # particles above which the numpy backend is announced as slow


@dataclass(frozen=True)
class StepResult:
    """One step: its number, the time [s] at its end, its length [s], the limit that set it, and all limits [s]."""

    step: int
    time: float
    length: float
    limiter: str
    limits: dict[str, float]


def fused(passes: Sequence[tuple[Effect, Pass]], backend: str) -> list[tuple[tuple[Effect, ...], Pass]]:
    """The passes in their order, each with its effects; one in place of several that one program computes together.

    It stands where the last of them stood: what all of them read is there by then, and accelerations add in any order.
    """
    result = [((effect,), p) for effect, p in passes]
    for _, p in list(passes):
        operation = REGISTRY.get(p.operation)
        for name in () if operation is None else operation.names():
            parts = {p.operation, *operation.entry(name).also}
            places = [k for k, (_, q) in enumerate(result) if q.operation in parts]
            if backend_of(name) != backend or len(parts) == 1 or len(places) != len(parts):
                continue
            together = [result[k] for k in places]
            taken, optional = operation.arguments(name), operation.as_computed_by(name).optional
            names = {a: b for _, q in together for a, b in q.names.items() if a in optional and a in taken}
            reads = tuple(dict.fromkeys(field for _, q in together for field in q.reads))
            if set(reads) <= {*taken, *names.values()}:
                one = Pass(p.operation, reads, updates=p.updates, names=names, algorithm=name.partition(":")[2])
                result[places[-1]] = (tuple(effect for effects, _ in together for effect in effects), one)
                for k in reversed(places[:-1]):
                    del result[k]
    return result


def step_limits(plan: Plan) -> dict[str, StepLimit]:
    """Largest stable steps of a plan by what limits them; at least one is finite whatever the particles do."""
    grid, effects = plan.grid, plan.effects
    limits = {"force": StepLimit.falling(grid.support_radius / 32)}  # 0.25 sqrt((h/2)/|a|)
    for effect in effects.values():
        limits |= effect.step_limits(grid, effects)
    if not any(limit.speed > 0 for limit in limits.values()):
        limits["resting"] = StepLimit.constant(plan.scene.end_time or 1.0)
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
        self.force_passes = fused(self.plan.passes, self.backend.name)
        grid, state = self.plan.grid, self.plan.state
        n = grid.count
        self.source: Path | None = None  # the checkpoint that it was resumed from
        self.time, self.steps, self.previous_length = 0.0, 0, 0.0
        self.first_length: float | None = None
        self.last: StepResult | None = None
        self.limits = step_limits(self.plan)
        self.greatest_speed = min((e.greatest_speed(grid) for e in self.plan.effects.values()), default=math.inf)
        self.limiters: dict[str, int] = {}  # how many steps each limit has set
        self.notes: list[str] = list(self.plan.notes)  # what a reader of the results must know
        if self.backend.name == "numpy" and n > MANY_FOR_ALL_PAIRS:
            self.notes.append(
                f"backend numpy computes all {n} x {n} pairs in each pass and is slow; it is meant for checks"
            )
        self.remarks: dict[str, str] = {}  # the notes that effects have made on the way, by effect
        self.timings = Timings()
        self.fields = {
            name: self.backend.zeros(f.shape(n), f.numpy_dtype(grid.dtype)) for name, f in self.plan.fields.items()
        }
        self._set("position", state.position)
        self._set("velocity", state.velocity)
        self._set("mass", state.mass)
        self._set("identity", np.arange(n))
        if "place" in self.fields:
            self._set("place", np.arange(n))
        for name, values in state.values.items():
            self._set(name, values)
        self.extremes = self.backend.zeros(5, grid.dtype)
        self.displacement = self.backend.zeros(2, grid.dtype)
        self.stopped_at_walls = 0  # how often a wall's plane has stopped a particle
        self.timestep = self.backend.zeros(2, grid.dtype)
        self.build_position = self.backend.asarray(self._host("position"))
        self._squared_way = math.inf
        self._set_between_steps = False  # whether velocities are still those that led to the positions
        # Whether accelerations alone change velocities, so that they bound what a step moves.
        self._moved_by_forces = not any(
            effect is not None and {"velocity", "position"} & {*p.updates, *p.writes} for effect, p in self.plan.motion
        )
        self._auditable = all(effect.moves_straight() for effect in self.plan.effects.values())
        self._margin = 0.0  # [m] by which two particles may still move against each other, once that was looked at
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
        self._sorter: NeighbourSearch | None = None
        self._rows: Any = None
        size = max((e.sorting_cell(grid) for e in self.plan.effects.values()), default=0.0)
        if self.search is None and size > 0 and self.backend.name != "numpy":
            self._sorter = NeighbourSearch(self.backend, grid.dim, grid.dtype, size, 0.0)
        self._prepare_walls()
        self._shared["neighbours"] = None
        self._shared["scratch"] = self.scratch = Scratch(self.backend)
        self._lists: tuple[Any, Any] | None = None
        self.stepper: HostStepper | DeviceStepper
        # What must look after its arrays before a step that the host does not see.
        self._attended: list[Any] = []
        if self.backend.name == "cuda" and not any(e.host_in_step for e in self.plan.effects.values()):
            groups = self._parameters.values()
            self._attended = [v for group in groups for v in group.values() if hasattr(v, "attend")]
        self.auditor = Auditor(self) if self.plan.scene.energy_audit is not None else None
        self._bind()
        self.stepper = (DeviceStepper if self.backend.name == "cuda" else HostStepper)(self)
        self._start()

    # Reading the state

    def field(self, name: str) -> np.ndarray:
        """A field's values on the host (a copy): a row for each particle, in the particles' first order.

        name  of a field, with its shape and unit in `refsim plan`: "position" (n, 3) [m], "density" (n,) [kg/m^3], ...

        Forces and densities are those of the last pass over them; `evaluate` brings them up to the present state.
        Raises InputError where the scene has no such field.
        """
        if name not in self.plan.fields:
            raise InputError(f"field: this scene has no field {name!r}; {suggestion(name, self.plan.fields)}")
        values = self._host(name)
        if self.plan.fields[name].rows is not None:
            return values
        ordered = np.empty_like(values)
        ordered[self._host("identity")] = values
        return ordered

    def set_field(self, name: str, values: np.ndarray) -> None:
        """Set a field of the state between two steps; the run goes on from there, with lists that belong to it.

        name    a particle field that outlives the step: "position", "velocity", "mass", "temperature", ...; the
                velocity is that of half a step before
        values  one row for each particle, in the order and unit of `field`

        Raises InputError where the scene has no such state, or the values have another shape or are not finite.
        """
        known = [n for n, f in self.plan.particle_fields.items() if f.state and n != "identity"]
        if name not in known:
            raise InputError(f"set_field: {name!r} is no state of this scene's particles; it has {', '.join(known)}.")
        values, wanted = np.asarray(values), self.plan.fields[name].shape(self.count)
        if values.shape != wanted:
            raise InputError(f"set_field: {name} has shape {values.shape}; give {wanted}, one row for each particle.")
        if not np.isfinite(values).all():
            raise InputError(f"set_field: {name} has values that are not finite; give finite ones.")
        self._set(name, values[self._host("identity")])
        self._set_between_steps = True
        for effect in self.plan.effects.values():
            for own, following in effect.after_setting(name, self._host).items():
                self._set(own, following)
        if self.auditor is not None:
            self.auditor.renew()
        if name == "position":
            self._squared_way, self._margin = math.inf, 0.0

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
        self._attend()
        written = {name for _, p in self.plan.passes for name in (*p.writes, *p.updates)}
        kept = {name: self._host(name) for name, f in self.plan.fields.items() if f.state and name in written}
        try:
            yield from self.launch(on_demand)
        finally:
            for name, values in kept.items():
                self.backend.assign(self.fields[name], values)

    def step(self) -> StepResult:
        """Advance by one stable step. Raises RunStopped, with the state as it was, where that is impossible."""
        if self.auditor is not None:
            self.auditor.begin()
        due = self._sorter is not None and self.steps % SORT_EVERY == 0
        if due and not self._attended:
            self._sort(self._sorter)
        self._update_list()
        self._attend()
        for each in self._attended if due else ():
            order = each.order(self.fields["position"])
            if order is not None:
                self._follow(order)
        done = self.stepper.advance()
        self._set_between_steps = False
        self._squared_way = done.squared_way
        self._margin = max(self._margin - 2 * done.greatest_way, 0.0)
        self.stopped_at_walls += done.stopped
        self.time += done.length
        self.steps += 1
        self.previous_length = done.length
        if not math.isfinite(self._squared_way):
            raise RunStopped(
                "non_finite",
                f"Step {self.steps} to {self.time:.6g} s moved a particle to a place that is not finite.",
            )
        for effect in self.plan.effects.values():
            if effect.watched:
                seen = {name: self.stepper.watched(name) for name in effect.watched}
                stop = effect.verdict(self.plan.grid, seen, done.length)
                if stop is not None:
                    raise RunStopped(stop[0], f"In step {self.steps} to {self.time:.6g} s {stop[1]}")
                said = None if effect.name in self.remarks else effect.remark(self.plan.grid, seen)
                if said is not None:
                    self._remark(effect.name, f"{effect.name}: from step {self.steps} on, at {self.time:.6g} s, {said}")
        self.limiters[done.limiter] = self.limiters.get(done.limiter, 0) + 1
        self.last = StepResult(self.steps, self.time, done.length, done.limiter, done.limits)
        if self.auditor is not None:
            self.auditor.after_step()
        return self.last

    def _remark(self, effect: str, note: str) -> None:
        self.remarks[effect] = note
        self.notes.append(note)

    def step_limits(self, extremes: Extremes) -> dict[str, float]:
        """Largest stable steps [s] by what limits them."""
        return stable_steps(self.limits, extremes)

    # Stopping and going on

    def checkpoint(self, path: str | os.PathLike[str], keep: int = 2) -> None:
        """Write a checkpoint from which `resume` goes on bit for bit; the run is not changed by it.

        keep  whole checkpoints to hold (see `refsim.io.checkpoint.write_checkpoint`, also for the errors)

        Raises RunStopped, before the last good checkpoint is touched, where the state or the forces on it are
        not finite, or the energy has grown beyond the bound of the scene's audit.
        """
        self.evaluate(on_demand=False)
        self.checked_extremes()
        if self.auditor is not None:
            self.auditor.look(note=False)
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
            "margin": self._margin,
            "set_between_steps": self._set_between_steps,
            "list_built": self._shared["neighbours"] is not None,
            "limiters": json.dumps(self.limiters),
            "stopped_at_walls": self.stopped_at_walls,
            "remarks": json.dumps(self.remarks),
        }
        if self.first_length is not None:
            attributes["first_length"] = self.first_length
        if self.auditor is not None:
            attributes["energy_audit"] = self.auditor.saved()
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

        path     a checkpoint, or a folder, of which the newest whole checkpoint is taken; where it is missing or
                 damaged, the one before it is taken, and `notes` says so
        backend  that of the checkpoint by default; on it the run goes on bit for bit. Another one is allowed,
                 and `notes` then says that the numbers differ by rounding
        scene    where given, it must be the checkpoint's but for end_time and name, which are taken from it

        Raises InputError where the checkpoint cannot be read or does not fit the scene.
        """
        saved = load_checkpoint(path)
        plan = saved.plan if scene is None else check_same_scene(scene, saved.plan, str(saved.file))
        simulation = cls(plan, backend or saved.clock.backend, threads)
        simulation._restore(saved)
        return simulation

    def _restore(self, saved: SavedRun) -> None:
        clock = saved.clock
        self.source = saved.file
        self.notes += saved.notes
        for name, values in saved.state.items():
            self.backend.assign(self.fields[name], values)
        self.backend.assign(self.build_position, saved.build_position)
        self.time, self.steps = clock.time, clock.steps
        self.previous_length, self.first_length = clock.previous_length, clock.first_length
        if "place" in self.fields:
            self.backend.invert(self.fields["identity"], self.fields["place"])
        self._start()
        self.backend.assign(self.timestep, np.array([0.0, self.previous_length], dtype=self.plan.grid.dtype))
        self.limiters = dict(saved.limiters)
        self.stopped_at_walls = clock.stopped_at_walls
        self._set_between_steps = clock.set_between_steps
        if self.auditor is not None and saved.audit is not None:
            self.auditor.restore(saved.audit)
        for effect, note in saved.remarks.items():
            self._remark(effect, note)
        if self.search is not None and clock.list_built:
            self.rebuild_list()
            self._squared_way, self._margin = clock.squared_way, clock.margin
            here = self.search.log.list_bytes  # the size that the list has grown to changes no result
            for name, value in saved.search_log.items():
                setattr(self.search.log, name, value)
            self.search.log.list_bytes = here
        now, then = versions(), saved.versions
        if clock.backend != self.backend.name:
            self.notes.append(
                f"resumed on backend {self.backend.name} from a checkpoint of backend {clock.backend}: the run goes"
                " on from the same state, but not bit for bit as it would have there"
            )
        elif now != then:
            changed = ", ".join(
                f"{name} {then.get(name)} -> {now[name]}" for name in now if now[name] != then.get(name)
            )
            self.notes.append(f"resumed with other versions ({changed}): bit for bit equality is not promised")

    # Inside

    def checked_extremes(self) -> Extremes:
        """Largest speed and acceleration. Raises RunStopped where one is not finite or the run has diverged."""
        self.extremes_call()
        speed2, force2, broken, rate, excess = (float(x) for x in self.backend.host(self.extremes))
        extremes = Extremes(math.sqrt(speed2), math.sqrt(force2), rate, excess)
        check_extremes(self, int(broken), extremes)
        return extremes

    def _start(self) -> None:
        """Fill the tables that follow from the state."""
        for name, call in self.start_calls:
            began = time.perf_counter()
            call()
            self.timings.add(name, time.perf_counter() - began)

    def launch(self, on_demand: bool) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Launch the passes, in order; after each, its operation and the fields it wrote."""
        self.backend.assign(self.fields["acceleration"], 0.0)
        for (name, rare, call), (_, p) in zip(self.force_calls, self.force_passes):
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
        return value.on_backend(self.backend) if hasattr(value, "on_backend") else value

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
        if search is None or self._squared_way <= search.allowed_way**2 or self._margin > 0:
            return
        began = time.perf_counter()
        if self._shared["neighbours"] is not None and self._moved_by_forces and math.isfinite(self._squared_way):
            way, walls = math.sqrt(self._squared_way), self._wall_data is not None
            self._margin = search.margin(self.fields["position"], self.build_position, way, walls)
            if self._margin > WORTH_KEEPING * search.allowed_way:
                self.timings.add("neighbours", time.perf_counter() - began)
                return
        # The audit steps positions back by the velocities, which must be those that led to them.
        if self._shared["neighbours"] is not None and self._auditable and not self._set_between_steps:
            search.audit(
                self.fields["position"],
                self.fields["velocity"],
                self.timestep,
                self._shared["neighbours"],
                self._shared.get("bounds"),
            )
        self._put_in_order(search)
        self.rebuild_list()
        missed = search.log.missed_neighbours
        if missed:
            raise RunStopped(
                "missed_neighbours",
                f"The neighbour list lacked {missed} neighbours of the audited particles up to step {self.steps} at"
                f" {self.time:.6g} s; give the scene a larger skin than {self.plan.scene.skin}.",
            )
        self.timings.add("neighbours", time.perf_counter() - began)

    def _put_in_order(self, search: NeighbourSearch) -> None:
        """Put the particles into cell order and remember where they are."""
        names = [name for name, f in self.plan.particle_fields.items() if f.state]
        moved = search.sort(self.fields["position"], [self.fields[name] for name in names], self.build_position)
        self.fields |= zip(names, moved)

    def _sort(self, search: NeighbourSearch) -> None:
        """Put particles that no neighbour list sorts into cell order: memory that is read together lies together."""
        began = time.perf_counter()
        self._put_in_order(search)
        if "place" in self.fields:
            self.backend.invert(self.fields["identity"], self.fields["place"])
        self._bind()
        self.stepper.rebind()
        self.timings.add("sorting", time.perf_counter() - began)

    def _attend(self) -> None:
        """Have everything that looks after its own arrays look at the particles' places."""
        for each in self._attended:
            if each.attend(self.fields["position"], moved=math.isinf(self._squared_way)):  # set between two steps
                self.stepper.rebind()

    def _follow(self, order: Any) -> None:
        """Put the particles into an order that is known, in the arrays where they are: memory read together is near."""
        began = time.perf_counter()
        arrays = [self.fields[name] for name, f in self.plan.particle_fields.items() if f.state]
        if self._rows is None or self._rows.order is not order or not self._rows.belongs_to(arrays):
            from refsim.backends import device

            self._rows = device.Rows(arrays, order)
        self._rows.launch()
        if "place" in self.fields:
            self.backend.invert(self.fields["identity"], self.fields["place"])
        self.timings.add("sorting", time.perf_counter() - began)

    def rebuild_list(self) -> None:
        """Build the list from the particles' present order and `build_position`."""
        assert self.search is not None
        known = self._lists
        near = self.search.build(self.build_position)
        at_walls = None if self._wall_data is None else self.search.build_against(self.build_position, self._static)
        self._squared_way = self._margin = 0.0
        if "place" in self.fields:
            self.backend.invert(self.fields["identity"], self.fields["place"])
        if known is None or near is not known[0] or at_walls is not known[1]:
            self._lists = (near, at_walls)
            self._shared["neighbours"] = near
            if self._wall_data is not None:
                self._shared["walls"] = with_list(*self._wall_data, at_walls)
            self._bind()
            self.stepper.rebind()

    def _bind(self) -> None:
        self.start_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.start]
        self.begin_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.begin]
        self.force_calls = [(p.operation, p.on_demand, self._bound(effects, p)) for effects, p in self.force_passes]
        self.motion_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.motion]
        self.extremes_call = self._bound((), Pass("sph.extremes"))

    def _bound(self, effects: tuple[Effect | None, ...], p: Pass) -> Callable[[], None]:
        """A pass as a call without arguments; those of no effect are the runner's own."""
        procedure = PROCEDURES.get(p.operation)
        operation = None
        if procedure is None:
            found = REGISTRY[p.operation]
            operation = found.as_computed_by(found.chosen(self.backend.name, p.algorithm))
        sources = (
            {name: value for e in effects if e is not None for name, value in self._parameters[e.name].items()},
            self._shared,
            self.fields,
            {
                "extremes": self.extremes,
                "displacement": self.displacement,
                "timestep": self.timestep,
                "build_position": self.build_position,
            },
        )

        def lookup(name: str) -> Any:
            name = p.names.get(name, name)
            owner, _, attribute = (name or "").partition(".")
            for source in sources:
                if owner in source:
                    return Current(source[owner], attribute) if attribute else source[owner]
            if name is None or (operation is not None and name in operation.optional):
                return None
            raise KeyError(f"{p.operation} takes {name!r}, which no effect of the scene provides")

        if procedure is not None:
            return procedure.bind(lookup)
        return self.backend.bind(operation, lookup, p.algorithm)


# What a checkpoint of a run holds


class Clock(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of a run that outlive a step, as `Simulation.snapshot` writes them beside its arrays."""

    backend: Literal["numpy", "cpu", "cuda"]
    time: float
    steps: int
    previous_length: float
    squared_way: float
    margin: float
    set_between_steps: bool
    list_built: bool
    stopped_at_walls: int
    limiters: str
    versions: str
    first_length: float | None = None
    search_log: str = "{}"
    energy_audit: str | None = None
    remarks: str = "{}"


@dataclass(frozen=True)
class SavedRun:
    """A checkpoint that was read and found to fit its own scene.

    file            where it lies
    plan            of the scene in it
    clock           time, steps and what else counts them
    state           fields that outlive a step, by name
    build_position  positions (n, 3) [m] at the last build of the neighbour list
    limiters        how many steps each limit has set
    versions        of the programs that wrote it
    search_log      counts of the neighbour search
    audit           what the energy audit remembers, where the scene asks for one
    remarks         notes that effects had made on the way, by effect
    notes           one sentence for each checkpoint that was passed over for it
    """

    file: Path
    plan: Plan
    clock: Clock
    state: dict[str, np.ndarray]
    build_position: np.ndarray
    limiters: dict[str, int]
    versions: dict[str, str]
    search_log: dict[str, int]
    audit: AuditState | None
    remarks: dict[str, str]
    notes: tuple[str, ...]


def load_checkpoint(path: str | os.PathLike[str]) -> SavedRun:
    """The run in a checkpoint, or in the newest whole checkpoint of a folder, all of it checked.

    Raises InputError, in one sentence, where there is none or it does not fit its own scene.
    """
    file, saved, notes = whole_checkpoint(path)
    plan = make_plan(scene_from_checkpoint(saved, str(file)))

    def wrong(what: str) -> InputError:
        return InputError(f"checkpoint {file}: {what}; start the run again.")

    try:
        clock = msgspec.convert(saved.attributes, Clock)
        limiters = msgspec.json.decode(clock.limiters, type=dict[str, int])
        then = msgspec.json.decode(clock.versions, type=dict[str, str])
        log = msgspec.json.decode(clock.search_log, type=dict[str, int])
        remarks = msgspec.json.decode(clock.remarks, type=dict[str, str])
        audit = msgspec.json.decode(clock.energy_audit, type=AuditState) if clock.energy_audit else None
    except (msgspec.MsgspecError, OverflowError, RecursionError) as error:
        words = str(error)[:200]
        raise wrong(f"its numbers are not those of a run ({words[:1].lower()}{words[1:]})") from None
    if (plan.scene.energy_audit is None) != (audit is None):
        raise wrong("its energy audit is not that of its scene")
    counts = {"steps": clock.steps, "stopped_at_walls": clock.stopped_at_walls, **limiters, **log}
    lengths = {"time": clock.time, "previous_length": clock.previous_length, "margin": clock.margin}
    if clock.first_length is not None:
        lengths["first_length"] = clock.first_length
    for name, value in counts.items():
        if not 0 <= value < 2**63:
            raise wrong(f"{name} = {value} is no count")
    for name, value in lengths.items():
        if not 0 <= value <= GREATEST:
            raise wrong(f"{name} = {value} is not possible")
    if not clock.squared_way >= 0:
        raise wrong(f"squared_way = {clock.squared_way} is not possible")
    if not log.keys() <= {f.name for f in dataclasses.fields(SearchLog)}:
        raise wrong(f"its search log has the entries {', '.join(log)}")
    shapes = {f"field.{name}": (f.shape(plan.grid.count), f.numpy_dtype(plan.grid.dtype))
              for name, f in plan.fields.items() if f.state}  # fmt: skip
    shapes["build_position"] = shapes["field.position"]
    for name, (shape, dtype) in shapes.items():
        values = saved.arrays.get(name)
        if values is None:
            raise wrong(f"it lacks {name!r}, so that it is not one of a run of this refsim")
        if values.shape != shape or values.dtype != dtype:
            raise wrong(f"{name} is {values.dtype} {values.shape}, and the scene wants {dtype} {shape}")
        if dtype.kind == "f" and not (np.abs(values) <= GREATEST).all():
            raise wrong(f"{name} has values that are not finite, or beyond {GREATEST:g}")
    state = {name.removeprefix("field."): saved.arrays[name] for name in shapes if name != "build_position"}
    if (state["mass"] <= 0).any():
        raise wrong(f"{int((state['mass'] <= 0).sum())} of its particles have no positive mass")
    if not np.array_equal(np.sort(state["identity"]), np.arange(plan.grid.count)):
        raise wrong("its particles' numbers (identity) are not each of 0, 1, 2, ... once")
    build_position = saved.arrays["build_position"]
    if plan.grid.dim == 2 and any(values[:, 2].any() for values in (state["position"], build_position)):
        raise wrong("it has particles with another z than 0 in a 2D scene")
    return SavedRun(file, plan, clock, state, build_position, limiters, then, log, audit, remarks, notes)
