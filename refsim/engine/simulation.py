"""The time loop over a plan, on one backend.

What a step needs beside the loop stands in modules of their own: `list_policy` (when the neighbour list is rebuilt),
`neighbour_lists`, `sorting`, `binding` (passes as calls), `stepping` (length of a step), `checkpoints`, `timings`.
"""

import contextlib
import functools
import math
import os
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from refsim.backends import arrays as backends
from refsim.backends.scratch import Scratch
from refsim.backends.threads import places
from refsim.core.capabilities import BringsWalls, FollowsSettings, HasPlanes, LimitsSpeed, Watches, having
from refsim.core.checked import plainly, suggestion
from refsim.core.effect import Effect, Extremes, Pass
from refsim.core.errors import InputError, RunStopped
from refsim.core.tables import Shown
from refsim.engine import stepping
from refsim.engine.audit import Auditor
from refsim.engine.balance import Balances
from refsim.engine.binding import bound, fused
from refsim.engine.checkpoints import load_checkpoint, restore, snapshot
from refsim.engine.counting import Counting
from refsim.engine.gauges import Gauges
from refsim.engine.motions import Motions
from refsim.engine.neighbour_lists import NeighbourLists
from refsim.engine.sorting import ParticleOrder
from refsim.engine.timings import Timings
from refsim.gauges import GaugeSeries
from refsim.io.checkpoint import Checkpoint, write_checkpoint
from refsim.io.scenes import check_same_scene
from refsim.neighbours import NeighbourSearch
from refsim.scene.checks import check_coincident, check_values
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.scene.shapes import as_floats
from refsim.smoothing import Smoothing
from refsim.sph import CROWD, DENSE, LIQUID

Compiling = Callable[[int, int], Callable[[], Any]]
P = ParamSpec("P")
R = TypeVar("R")
DERIVED = ("identity", "position_residual")  # state that is not set by hand
INSIDE = 1e-3  # spacings behind a plane that a position may be set, for rounding
STOPPED, ENOUGH = 2e-3, 100  # stops by planes over steps times particles that get a note, and least number of both
HELD = 0.3  # the same that stop the run
MANY_FOR_ALL_PAIRS = 2000  # particles above which the numpy backend is announced as slow


@dataclass(frozen=True)
class StepResult:
    """One step: its number, the time [s] at its end, its length [s], the limit that set it, and all limits [s]."""

    step: int
    time: float
    length: float
    limiter: str
    limits: dict[str, float]


def _at_work(method: Callable[Concatenate["Simulation", P], R]) -> Callable[Concatenate["Simulation", P], R]:
    """The method within `Simulation.at_work`."""

    @functools.wraps(method)
    def call(self: "Simulation", *given: P.args, **named: P.kwargs) -> R:
        with self.at_work():
            return method(self, *given, **named)

    return call


class Simulation(Shown):
    """A scene on a backend, step by step.

    scene    the scene, or a plan made from it
    backend  "numpy" (the references, all pairs), "cpu" or "cuda"; never swapped for another
    threads  CPU threads; by default one for 1,024 particles, at most all
    profile  time every pass to its end (`timings`); on "cuda" the host then launches the passes one by one and waits
             after each, instead of launching a step as one graph. The results are the same
    compiling  is told (kernels, processes) where a CPU's kernels are compiled before the first step, and gives what is
             called after each

    Raises InputError for bad input or a backend that is not there.
    """

    @plainly
    def __init__(
        self, scene: Scene | Plan, backend: str = "cpu", threads: int | None = None, profile: bool = False,
        compiling: Compiling | None = None,
    ) -> None:  # fmt: skip
        self.timings = Timings()
        self.plan = scene if isinstance(scene, Plan) else make_plan(scene)
        self.backend = backends.choose(backend)
        grid = self.plan.grid
        self.threads = backends.threads_of(self.backend, threads, grid.count)
        self.force_passes = fused(self.plan.passes, self.backend.name)
        self._current: set[str] = set()  # fields that follow from the state and belong to the present one
        self._needs: dict[str, frozenset[int]] = {}
        self.source: Path | None = None
        self.time, self.steps, self.previous_length = 0.0, 0, 0.0
        self.first_length: float | None = None
        self.last: StepResult | None = None
        self.limits = stepping.step_limits(self.plan)
        speeds = (effect.greatest_speed(grid) for effect in having(self.plan.effects, LimitsSpeed))
        self.greatest_speed = min(speeds, default=math.inf)
        self._watching: list[Any] = [effect for effect in having(self.plan.effects, Watches) if effect.watched]
        self.limiters: dict[str, int] = {}
        self.stopped_at_walls = 0
        self.notes: list[str] = list(self.plan.notes)
        if self.backend.name == "numpy" and self.count > MANY_FOR_ALL_PAIRS:
            self.notes.append(
                f"backend numpy computes all {self.count} x {self.count} pairs in each pass and is slow; it is meant"
                " for checks"
            )
        self.remarks: dict[str, str] = {}
        self.timings.compiles = self.backend.name != "numpy"
        self.timings.wait = self.backend.synchronize if profile else None
        self._make(compiling or (lambda kernels, processes: lambda: None))

    def at_work(self) -> AbstractContextManager[None]:
        """Have the loops of the block use this simulation's CPU threads; after it the process's are as before."""
        return backends.on_threads(self.threads)

    @_at_work
    def _make(self, compiling: Compiling) -> None:
        """Make the arrays and what a step needs beside them, bind the passes, and fill the first tables."""
        self._allocate()
        self._shared = self._placed(self.plan.shared)
        self._shared["scratch"] = self.scratch = Scratch(self.backend)
        self._parameters = {effect: self._placed(group) for effect, group in self.plan.parameters.items()}
        self.motions = Motions(self) if self.plan.scene.motion else None
        self.order = ParticleOrder(self)
        self.lists = NeighbourLists(self)
        self.auditor = Auditor(self) if self.plan.scene.energy_audit is not None else None
        self.balances = Balances(self)
        self.counting = Counting(self)
        self.gauges = Gauges(self) if self.plan.scene.gauge else None
        if self.backend.name == "cpu":
            with self.timings.part("compiling"):
                self._compile_ahead(compiling)
        self._bind()
        self.stepper = (stepping.DeviceStepper if self.backend.name == "cuda" else stepping.HostStepper)(self)
        self.start()

    def _placed(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Parameter groups on the backend; a CPU's programs are compiled for the smoothing kernel."""
        cpu = self.backend.name == "cpu"
        return {
            name: backends.on_backend(v.fixed() if cpu and isinstance(v, Smoothing) else v, self.backend)
            for name, v in values.items()
        }

    def _allocate(self) -> None:
        """Make the fields and what every step needs beside them."""
        grid, state = self.plan.grid, self.plan.state
        self.fields = {
            name: self.backend.zeros(f.shape(self.count), f.numpy_dtype(grid.dtype))
            for name, f in self.plan.fields.items()
        }
        given = {"position": state.position, "velocity": state.velocity, "mass": state.mass}
        numbers = {name: np.arange(self.count) for name in ("identity", "place") if name in self.fields}
        for name, values in (given | numbers | dict(state.values)).items():
            self._set(name, values)
        self.extremes = self.backend.zeros(7, grid.dtype)
        self.displacement = self.backend.zeros(2, grid.dtype)
        self.timestep = self.backend.zeros(2, grid.dtype)
        self.build_position = self.backend.asarray(self._host("position"))

    def _facts(self) -> tuple[str, list[tuple[str, str]]]:
        grid = self.plan.grid
        last = "none" if self.last is None else f"{self.last.length:.4g} s, set by {self.last.limiter}"
        return f"Simulation of {self.plan.scene.name!r}", [
            ("particles", f"{self.count:,} in {grid.dim}D, {grid.dtype}, backend {self.backend.name}"),
            ("time", f"{self.time:.6g} s after {self.steps:,} steps"),
            ("last step", last),
            ("effects", ", ".join(self.plan.effects) or "none"),
            ("fields", ", ".join(self.plan.fields)),
        ]

    # Reading and setting the state

    @property
    def count(self) -> int:
        """Number of particles."""
        return self.plan.grid.count

    @property
    def search(self) -> NeighbourSearch | None:
        """The neighbour search; None where no list is needed."""
        return self.lists.search

    @plainly
    def field(self, name: str) -> np.ndarray:
        """A field's values on the host (a copy): a row for each particle, in the particles' first order.

        name  of a field, with its shape and unit in `refsim plan`: "position" (n, 3) [m], "density" (n,) [kg/m^3], ...

        Every field belongs to the present state, at `time`, before the first step and after each: where densities,
        forces, surfaces and the like do not yet, the passes that the field needs are run, and no others; the run is
        not changed by it. Velocities are half a step behind. What follows from a step's length, such as the pressure
        of `iisph` and the forces on solids, is of the last step and no part of "acceleration".

        Reals are of the scene's dtype. Positions are float64, with what rounding took from them, where the scene lies
        so far from the origin that it is computed relative to a place of its own (`plan.grid.origin`).

        Raises InputError where the scene has no such field, and where only a step computes it and there was none;
        RunStopped where the state does not allow to compute it.
        """
        if name not in self.plan.fields:
            raise InputError(f"field: this scene has no field {name!r}; {suggestion(name, self.plan.fields)}")
        self.bring((name,))
        if not self._needed(name) and self.last is None and self._is_of_steps(name):
            raise InputError(f"field: {name!r} is computed in a step, and there was none yet; call step() before.")
        return self.stored(name)

    def stored(self, name: str) -> np.ndarray:
        """A field's values as they are on the backend, in the order of `field`."""
        values = self._host(name)
        if name == "position" and any(self.plan.grid.origin):
            values = self.plan.grid.absolute(values)
            values += self._host("position_residual") if "position_residual" in self.fields else 0.0
        if self.plan.fields[name].rows is not None:
            return self.lists.in_first_order(values) if name in ("wall_pressure", "wall_strain") else values
        ordered = np.empty_like(values)
        ordered[self._host("identity")] = values
        return ordered

    @plainly
    def set_field(self, name: str, values: np.ndarray) -> None:
        """Set a field of the state between two steps; the run goes on from there, with lists that belong to it.

        name    a particle field that outlives the step: "position", "velocity", "mass", "temperature", ...; the
                velocity is that of half a step before. Set alone it strains an advanced density from the next step on,
                as forces do; after positions it is what led to them
        values  one row for each particle, in the order and unit of `field`; positions are places in the scene

        Raises InputError where the scene has no such state, or the values have another shape or are none that a scene
        may begin with: not finite, no positive mass, off the plane in 2D, behind a wall, two particles at one place.
        """
        known = [n for n, f in self.plan.particle_fields.items() if f.state and n not in DERIVED]
        if name not in known:
            raise InputError(f"set_field: {name!r} is no state of this scene's particles; it has {', '.join(known)}.")
        wanted = self.plan.fields[name].shape(self.count)
        try:
            values = np.asarray(values)
            values = as_floats(values.astype(int) if values.dtype == bool else values)
        except (TypeError, ValueError):
            raise InputError(f"set_field: {name} is no array of numbers; give {wanted} numbers.") from None
        if values.shape != wanted:
            raise InputError(f"set_field: {name} has shape {values.shape}; give {wanted}, one row for each particle.")
        check_values("set_field", name, values, self.plan.grid.dim, self.plan.grid.dtype)
        if name == "position":
            self._check_places(values)
        if name == "velocity" and not self.lists.velocities_set:
            self._end_step_of_density()
        self._set(name, values[self._host("identity")])
        self.outdate()
        self.lists.velocities_set |= name in ("position", "velocity")
        self.lists.policy.velocities_set()
        for effect in having(self.plan.effects, FollowsSettings):
            for own, following in effect.after_setting(name, self._host).items():
                self._set(own, following)
        if self.auditor is not None:
            self.auditor.renew()
        self.balances.renew()
        if name == "position":
            self.lists.policy.invalidate()

    def _check_places(self, values: np.ndarray) -> None:
        """Raise InputError where positions (n, 3) [m] coincide, or one that is another than now is behind a plane."""
        grid = self.plan.grid
        there = grid.local(values)
        check_coincident(there, grid.dtype, "set_field")
        moved = (values != self.stored("position")).any(1, keepdims=True)
        bounding: list[Any] = having(self.plan.effects, HasPlanes)
        for planes in (effect.local(grid) for effect in bounding):
            held = np.where(moved, there, np.clip(there, *planes.domain(grid)))
            planes.check_inside(grid, held, INSIDE * grid.spacing)

    @plainly
    def gauge(self, name: str) -> GaugeSeries:
        """What the scene's gauge of this name has measured so far. Raises InputError where there is no such gauge."""
        if self.gauges is None:
            raise InputError(f"gauge: the scene has no gauge {name!r}; add one to the scene.")
        return self.gauges.series(name)

    # Advancing

    @_at_work
    def step(self) -> StepResult:
        """Advance by one stable step. Raises RunStopped, with the state as it was, where that is impossible."""
        places.keep()
        if self.auditor is not None:
            self.auditor.begin()
        if self.gauges is not None:
            self.gauges.begin()
        self._current.clear()
        self.order.sort_alone()
        self.lists.update()
        self.order.attend()
        self.order.follow()
        done = self.stepper.advance()
        self._current.clear()
        self.lists.velocities_set = False
        self.lists.policy.after_step(done)
        self.stopped_at_walls += done.stopped
        self.time += done.length
        if self.motions is not None:
            self.motions.move(self.time)
        self.steps += 1
        self.previous_length = done.length
        if not math.isfinite(done.squared_displacement):
            raise RunStopped(
                "non_finite",
                f"Step {self.steps} to {self.time:.6g} s moved a particle to a place that is not finite.",
            )
        self._note_density(done.dense)
        self._note_stops()
        self._watch(done.length)
        self.limiters[done.limiter] = self.limiters.get(done.limiter, 0) + 1
        self.last = StepResult(self.steps, self.time, done.length, done.limiter, done.limits)
        if self.auditor is not None:
            self.auditor.after_step()
        self.balances.after_step()
        self.counting.after_step()
        if self.gauges is not None:
            self.gauges.after_step()
        return self.last

    def _note_density(self, dense: int) -> None:
        """Add a note to the run where more particles than may be are above the first bound of the liquid's density."""
        if dense > stepping.most_dense(self) and LIQUID not in self.remarks:
            words = f"{LIQUID}: from step {self.steps} on, at {self.time:.6g} s, {dense} of {self.count} particles"
            bound = f"more than {100 * CROWD:g} %, are denser than {DENSE:g} times the rest density"
            self.remark(LIQUID, f"{words}, {bound}: take a larger sound_speed, or a shorter step with iisph")

    def _note_stops(self) -> None:
        """Add a note where planes stop more particles than spray does; raise RunStopped where they hold the liquid.

        Between mirrored walls a film lies on planes, and so do solids: their runs are not stopped.
        """
        share = self.stopped_at_walls / (self.steps * self.count)
        if share <= STOPPED or min(self.steps, self.count) < ENOUGH:
            return
        extrapolated = any(effect.extrapolates() for effect in having(self.plan.effects, BringsWalls))
        advice = "a smaller spacing" if extrapolated else "box_walls with model = 'extrapolated'"
        words = (
            f"up to step {self.steps}, at {self.time:.6g} s, planes have stopped {100 * share:.2g} % of the particles"
            f" in a step: the walls do not hold the liquid; take {advice}, or a smaller support_radius"
        )
        if "planes" not in self.remarks:
            self.remark("planes", words)
        if share > HELD and extrapolated and self.plan.grid.solids is None:
            raise RunStopped("held_by_planes", f"{words[0].upper()}{words[1:]}.")

    def _watch(self, length: float) -> None:
        """Show the effects what they watch: they may stop the run, or add a note to it."""
        grid = self.plan.grid
        for effect in self._watching:
            seen = {name: self.stepper.watched(name) for name in effect.watched}
            stop = effect.verdict(grid, seen, length)
            if stop is not None:
                raise RunStopped(stop[0], f"In step {self.steps} to {self.time:.6g} s {stop[1]}")
            said = None if effect.name in self.remarks else effect.remark(grid, seen)
            if said is not None:
                self.remark(effect.name, f"{effect.name}: from step {self.steps} on, at {self.time:.6g} s, {said}")

    def remark(self, effect: str, note: str) -> None:
        """Add an effect's note to the run."""
        self.remarks[effect] = note
        self.notes.append(note)

    @_at_work
    def evaluate(self, on_demand: bool = True) -> None:
        """Run the passes on the present state, whether or not fields belong to it; the run is not changed by it.

        `field` does this by itself. on_demand: also those that no step needs
        """
        for _ in self.replay_passes(on_demand):
            pass

    def refresh(self, on_demand: bool = False) -> None:
        """Run the passes on the present state unless all of their fields belong to it."""
        if not all(p.written <= self._current for _, p in self.force_passes if on_demand or not p.on_demand):
            self.evaluate(on_demand)

    @_at_work
    def bring(self, names: Sequence[str]) -> None:
        """Run the passes on which these fields depend, and no others, unless the fields belong to the present state."""
        stale = [name for name in names if name not in self._current]
        needed = frozenset().union(*map(self._needed, stale))
        if needed or "acceleration" in stale:
            for _ in self.replay_passes(only=needed):
                pass

    def _needed(self, name: str) -> frozenset[int]:
        """Numbers of the passes on which a field depends that follows from the state; none for other fields."""
        if name not in self._needs:
            wanted, taken, more = {name}, set[int](), {-1}
            while more and not self.plan.fields[name].state:
                more = {k for k, (_, p) in enumerate(self.force_passes) if p.written & wanted} - taken
                taken |= more
                wanted.update(*((*p.written, *p.reads) for k, (_, p) in enumerate(self.force_passes) if k in more))
            self._needs[name] = frozenset(taken)
        return self._needs[name]

    def _end_step_of_density(self) -> None:
        """Advance an advanced density by the velocities that led to the positions, before others are set."""
        if "advanced_excess" in self.fields and self.previous_length > 0:
            self.bring(("density_excess",))
            self._set("advanced_excess", self._host("density_excess"))
            self.backend.assign(self.timestep, 0.0)

    def outdate(self) -> None:
        """Note that the state is another one, or sorted anew: no field that follows from it belongs to it any more."""
        self._current.clear()
        self.stepper.known = False

    def _is_of_steps(self, name: str) -> bool:
        """Whether only a step writes a field, which does not outlive it."""
        first = any(name in p.written for _, p in self.plan.start)
        in_step = any(name in p.written for _, p in (*self.plan.begin, *self.plan.motion))
        return in_step and not first and not self.plan.fields[name].state

    def replay_passes(
        self, on_demand: bool = False, only: Collection[int] | None = None
    ) -> Generator[tuple[str, tuple[str, ...]], None, None]:
        """Run the passes on the present state one by one; after each, its operation and the fields it wrote.

        What outlives the step (warm starts, say) is put back at the end, so that the run is not changed. only: numbers
        of the passes to run, in place of all
        """
        self.lists.update()
        self.order.attend()
        if only is None:
            only = [k for k, (_, p) in enumerate(self.force_passes) if on_demand or not p.on_demand]
        touched = set().union(*(self.force_passes[k][1].written for k in only))
        kept = {name: self._host(name) for name, f in self.plan.fields.items() if f.state and name in touched}
        self._current -= touched
        self.stepper.known = False
        try:
            yield from self.launch(only)
            self._current |= touched
        finally:
            for name, values in kept.items():
                self.backend.assign(self.fields[name], values)

    def launch(self, only: Collection[int] | None = None) -> Iterator[tuple[str, tuple[str, ...]]]:
        """Launch the passes of a step, or those of these numbers; after each, its operation and the fields it wrote."""
        if only is None or self._needed("acceleration") <= set(only):  # also where no pass adds to it
            self.backend.assign(self.fields["acceleration"], 0.0)
        for k, ((name, rare, call), (_, p)) in enumerate(zip(self.force_calls, self.force_passes)):
            if (not rare) if only is None else k in only:
                self.timings.run(name, call)
                yield name, (*p.writes, *p.updates)

    @_at_work
    def start(self) -> None:
        """Fill the tables that follow from the state."""
        for name, call in self.start_calls:
            self.timings.run(name, call)

    def checked_extremes(self) -> Extremes:
        """Largest speed and acceleration. Raises RunStopped where one is not finite or the run has diverged."""
        self.timings.run("sph.extremes", self.extremes_call)
        speed2, force2, broken, *others = (float(x) for x in self.backend.host(self.extremes))
        extremes = Extremes(math.sqrt(speed2), math.sqrt(force2), *others)
        stepping.check_extremes(self, int(broken), extremes)
        return extremes

    # Stopping and going on

    @plainly
    @_at_work
    def checkpoint(self, path: str | os.PathLike[str], keep: int = 2) -> None:
        """Write a checkpoint from which `resume` goes on bit for bit; the run is not changed by it.

        keep  whole checkpoints to hold (see `refsim.io.checkpoint.write_checkpoint`, also for the errors)

        Raises RunStopped, before the last good checkpoint is touched, where the state or the forces on it are
        not finite, or the energy has grown beyond the bound of the scene's audit.
        """
        self.refresh()
        self.checked_extremes()
        if self.auditor is not None:
            self.auditor.look(note=False)
        self.balances.look()
        saved = self.snapshot()
        write_checkpoint(path, saved.arrays, saved.attributes, keep)

    def snapshot(self) -> Checkpoint:
        """All that outlives a step, on the host: what a checkpoint file holds."""
        return snapshot(self)

    @classmethod
    @plainly
    def resume(
        cls,
        path: str | os.PathLike[str],
        backend: str | None = None,
        threads: int | None = None,
        scene: Scene | None = None,
        profile: bool = False,
        compiling: Compiling | None = None,
    ) -> "Simulation":
        """The simulation as it was when the checkpoint was written.

        path     a checkpoint, or a folder, of which the newest whole checkpoint is taken; where it is missing or
                 damaged, the one before it is taken, and `notes` says so
        backend  that of the checkpoint by default; on it the run goes on bit for bit. Another one is allowed,
                 and `notes` then says that the numbers differ by rounding
        scene    where given, it must be the checkpoint's but for end_time and name, which are taken from it
        profile, compiling  as for a new simulation

        Raises InputError where the checkpoint cannot be read or does not fit the scene.
        """
        saved = load_checkpoint(path)
        plan = saved.plan if scene is None else check_same_scene(scene, saved.plan, str(saved.file))
        simulation = cls(plan, backend or saved.clock.backend, threads, profile, compiling)
        restore(simulation, saved)
        return simulation

    # Inside

    def rebind(self) -> None:
        """Bind the passes again: arrays have changed."""
        self._bind()
        self.stepper.rebind()

    def _compile_ahead(self, compiling: Compiling) -> None:
        """Compile what the passes and the lists need, in processes side by side, into the cache."""
        from refsim.backends.ahead import compile_ahead, launched_by

        with self.lists.empty() as launched:
            self._bind()
            passes = [call for _, call in (*self.start_calls, *self.begin_calls, *self.motion_calls)]
            passes += [call for _, _, call in self.force_calls]
            for call in (*passes, self.extremes_call):
                with contextlib.suppress(AttributeError, KeyError):  # a procedure, or arrays that a pass before makes
                    launched += launched_by(call.func, call.args)
            compile_ahead(launched, compiling)

    def _bind(self) -> None:
        self.start_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.start]
        self.begin_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.begin]
        self.force_calls = [(p.operation, p.on_demand, self._bound(effects, p)) for effects, p in self.force_passes]
        self.motion_calls = [(p.operation, self._bound((effect,), p)) for effect, p in self.plan.motion]
        self.extremes_call = self._bound((), Pass("sph.extremes"))

    def _bound(self, effects: tuple[Effect | None, ...], p: Pass) -> Any:
        """A pass as a call without arguments; those of no effect are the loop's own."""
        groups: dict[str, Any] = {}
        for effect in effects:
            groups |= {} if effect is None else self._parameters[effect.name]
        own = {
            "extremes": self.extremes,
            "displacement": self.displacement,
            "timestep": self.timestep,
            "build_position": self.build_position,
        }
        return bound(p, self.backend, (groups, self._shared, self.fields, own))

    def _host(self, name: str) -> np.ndarray:
        return np.array(self.backend.host(self.fields[name]))

    def _set(self, name: str, values: np.ndarray) -> None:
        if name == "position":
            values = self.plan.grid.local(values)
            if "position_residual" in self.fields:
                self.backend.assign(self.fields["position_residual"], 0.0)
        self.backend.assign(self.fields[name], values.astype(self.fields[name].dtype))
