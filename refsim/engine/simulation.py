"""A run as its user holds it: its state, with what is read of it, set in it, and done with it."""

import functools
import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np

from refsim.backends import arrays as backends
from refsim.backends.threads import places
from refsim.core.capabilities import FollowsSettings, HasPlanes, effects_with
from refsim.core.checked import plainly, suggestion
from refsim.core.errors import InputError
from refsim.core.tables import Shown
from refsim.engine.checkpoints import load_checkpoint, restore, snapshot
from refsim.engine.counting import Balances, Counting, watch
from refsim.engine.gauges import Gauges
from refsim.engine.launching import bind, bring, needed, ready, refresh, replay, start
from refsim.engine.neighbour_lists import follow, sort_now_and_then
from refsim.engine.state import State, StepResult
from refsim.engine.stepping import DeviceStepper, advance, checked_extremes
from refsim.engine.timings import Timings
from refsim.gauges import GaugeSeries
from refsim.io.checkpoint import Checkpoint, check_same_scene, write_checkpoint
from refsim.scene.checks import check_coincident, check_values
from refsim.scene.plan import Plan, make_plan
from refsim.scene.scene import Scene
from refsim.scene.shapes import as_floats

P = ParamSpec("P")
R = TypeVar("R")
DERIVED = ("identity", "position_residual")  # state that is not set by hand
INSIDE = 1e-3  # spacings behind a plane that a position may be set, for rounding
MANY_FOR_ALL_PAIRS = 2000  # particles above which the numpy backend is announced as slow


def _at_work(method: Callable[Concatenate["Simulation", P], R]) -> Callable[Concatenate["Simulation", P], R]:
    """The method within `Simulation.at_work`."""

    @functools.wraps(method)
    def call(self: "Simulation", *given: P.args, **named: P.kwargs) -> R:
        with self.at_work():
            return method(self, *given, **named)

    return call


class Simulation(State, Shown):
    """A scene on a backend, step by step.

    scene    the scene, or a plan made from it
    backend  "numpy" (the references, all pairs), "cpu" or "cuda"; never swapped for another
    threads  CPU threads; by default one for 1,024 particles, at most all
    profile  time every pass to its end (`timings`); on "cuda" the host then launches the passes one by one and waits
             after each, instead of launching a step as one graph. The results are the same

    Beside what is defined here it has `plan`, `time` [s], `steps`, `count` of particles, `search` (of neighbours, or
    None), `last` step, `limiters` (steps by what set their length), `stopped_at_walls` and `notes`.

    Raises InputError for bad input or a backend that is not there.
    """

    @plainly
    def __init__(
        self, scene: Scene | Plan, backend: str = "cpu", threads: int | None = None, profile: bool = False
    ) -> None:
        plan = scene if isinstance(scene, Plan) else make_plan(scene)
        timings, chosen = Timings(), backends.choose(backend)
        self.threads = backends.threads_of(chosen, threads, plan.grid.count)
        timings.compiles = chosen.name != "numpy"
        timings.wait = chosen.synchronize if profile else None
        with self.at_work():
            super().__init__(plan, chosen, timings)
            if chosen.name == "numpy" and self.count > MANY_FOR_ALL_PAIRS:
                pairs = f"all {self.count} x {self.count} pairs in each pass"
                self.notes.append(f"backend numpy computes {pairs} and is slow; it is meant for checks")
            self.balances, self.counting = Balances(self), Counting(self)
            self.gauges = Gauges(self) if plan.scene.gauge else None
            bind(self)
            self.stepper = DeviceStepper(self) if chosen.name == "cuda" else None
            start(self)

    def at_work(self) -> AbstractContextManager[None]:
        """Have the loops of the block use this simulation's CPU threads; after it the process's are as before."""
        return backends.on_threads(self.threads)

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
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

    @plainly
    @_at_work
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
        bring(self, (name,))
        if not needed(self, name) and self.last is None and self.plan.is_of_steps(name):
            raise InputError(f"field: {name!r} is computed in a step, and there was none yet; call step() before.")
        return self.stored(name)

    @plainly
    @_at_work
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
        self.write_field(name, values[self.host("identity")])
        self.outdate()
        self.lists.velocities_set |= name in ("position", "velocity")
        self.lists.velocities_changed()
        for effect in effects_with(self.plan.effects, FollowsSettings):
            for field, following in effect.after_setting(name, self.host).items():
                self.write_field(field, following)
        self.balances.renew(self)
        if name == "position":
            self.lists.invalidate()

    def _check_places(self, values: np.ndarray) -> None:
        """Raise InputError where positions (n, 3) [m] coincide, or one that is another than now is behind a plane."""
        grid = self.plan.grid
        there = grid.local(values)
        check_coincident(there, grid.dtype, "set_field")
        moved = (values != self.stored("position")).any(1, keepdims=True)
        bounding: list[Any] = effects_with(self.plan.effects, HasPlanes)
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
        if self.gauges is not None:
            self.gauges.begin(self)
        self.current.clear()
        sort_now_and_then(self)
        ready(self)  # with lists that hold every pair
        follow(self)
        stepper = None if self.own_forces else self.stepper
        done = advance(self) if stepper is None else stepper.advance()  # forces, the length, motion
        self.tick(done)
        watch(self, done, self.host if stepper is None else stepper.watched)
        self.limiters[done.limiter] = self.limiters.get(done.limiter, 0) + 1
        self.last = StepResult(self.steps, self.time, done.length, done.limiter, done.limits)
        self.balances.after_step(self)
        self.counting.after_step(self)
        if self.gauges is not None:
            self.gauges.after_step(self)
        return self.last

    @plainly
    def add_force(self, force: Callable[[float, Mapping[str, Any]], None]) -> None:
        """Have `force(time, fields)` called in each step, before the scene's own forces.

        force  adds its acceleration [m/s^2] to fields["acceleration"] in place. The fields are the run's own arrays, no
               copies, rows in the order of the memory: NumPy's on a CPU; with backend "cuda" device arrays, which have
               `__cuda_array_interface__`, so that `cupy.asarray(fields["velocity"])` shares them. Position (seen from
               `plan.grid.origin`), velocity and mass belong to the state at `time` [s]; what passes compute, to the
               step before. Where the continuity equation with viscosity begins the accelerations, it stands before
               `force`, and the density is of this step.

        On a GPU steps are then launched pass by pass. The limit of the step knows its acceleration, and no stiffness.
        Raises InputError behind the first step.
        """
        if self.steps:
            raise InputError("add_force: the run has begun; add the force before the first step.")
        self.own_forces.append(force)
        self.current.clear()

    @_at_work
    def evaluate(self, on_demand: bool = True) -> None:
        """Run the passes on the present state, whether or not fields belong to it; the run is not changed by it.

        `field` does this by itself. on_demand: also those that no step needs
        """
        for _ in replay(self, on_demand):
            pass

    def _end_step_of_density(self) -> None:
        """Advance an advanced density by the velocities that led to the positions, before others are set."""
        if "advanced_excess" in self.fields and self.previous_length > 0:
            bring(self, ("density_excess",))
            self.write_field("advanced_excess", self.host("density_excess"))
            self.backend.assign(self.timestep, 0.0)

    # Stopping and going on

    @plainly
    @_at_work
    def checkpoint(self, path: str | os.PathLike[str], keep: int = 2) -> None:
        """Write a checkpoint from which `resume` goes on bit for bit; the run is not changed by it.

        keep  whole checkpoints to hold (see `refsim.io.checkpoint.write_checkpoint`, also for the errors)

        Raises RunStopped, before the last good checkpoint is touched, where the state or the forces on it are
        not finite.
        """
        refresh(self)
        checked_extremes(self)
        self.balances.look(self)
        saved = self.snapshot()
        write_checkpoint(path, saved.arrays, saved.attributes, keep)

    def snapshot(self) -> Checkpoint:
        """All that outlives a step, on the host: what a checkpoint file holds."""
        tables = {} if self.gauges is None else self.gauges.tables()
        return snapshot(self, tables, self.counting.greatest)

    @classmethod
    @plainly
    def resume(
        cls,
        path: str | os.PathLike[str],
        backend: str | None = None,
        threads: int | None = None,
        scene: Scene | None = None,
        profile: bool = False,
    ) -> "Simulation":
        """The simulation as it was when the checkpoint was written.

        path     a checkpoint, or the folder of a run; where it is missing or damaged, the one before it is taken, and
                 `notes` says so
        backend  that of the checkpoint by default; on it the run goes on bit for bit. Another one is allowed,
                 and `notes` then says that the numbers differ by rounding
        scene    where given, it must be the checkpoint's but for end_time and name, which are taken from it
        profile  as for a new simulation

        Raises InputError where the checkpoint cannot be read or does not fit the scene.
        """
        saved = load_checkpoint(path)
        plan = saved.plan if scene is None else check_same_scene(scene, saved.plan, str(saved.file))
        simulation = cls(plan, backend or saved.clock.backend, threads, profile)
        restore(simulation, saved)
        if simulation.gauges is not None:
            simulation.gauges.restore(saved.gauges)
        simulation.balances.renew(simulation)
        simulation.counting.greatest = saved.clock.greatest_miscount
        return simulation
