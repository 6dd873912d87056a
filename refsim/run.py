"""The time loop over a plan, on one backend."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim import backend as backends
from refsim.boundary.walls import WallParticles, with_list
from refsim.effect import Extremes
from refsim.errors import RunStopped
from refsim.neighbours import NeighbourSearch
from refsim.operation import REGISTRY
from refsim.scene import Plan, Scene, make_plan

SMALLEST_STEP = 1e-6  # share of the first step below which the run is taken to have diverged


@dataclass(frozen=True)
class StepResult:
    """One step: its length, who limited it, all limits, and why the run cannot go on (None if it can)."""

    step: int
    time: float
    length: float
    limiter: str
    limits: dict[str, float]
    reason: str | None = None


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
        self.stopped_at_walls = 0
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
        self._update_list()
        self.backend.assign(self.fields["acceleration"], 0.0)
        for name, rare, call in self._calls:
            if on_demand or not rare:
                began = time.perf_counter()
                call()
                self.timings.add(name, time.perf_counter() - began)

    def step(self) -> StepResult:
        """Advance by one stable step. Raises RunStopped, with the state as it was, where that is impossible."""
        self.evaluate(on_demand=False)
        began = time.perf_counter()
        self._own["sph.extremes"]()
        speed2, force2, broken = (float(x) for x in self.backend.host(self._extremes))
        if broken:
            raise RunStopped(
                "non_finite",
                f"In step {self.steps} at {self.time:.6g} s {int(broken)} particles have a velocity or an"
                " acceleration that is not finite.",
            )
        limits = self.step_limits(Extremes(math.sqrt(speed2), math.sqrt(force2)))
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
        return StepResult(self.steps, self.time, length, limiter, limits)

    def step_limits(self, extremes: Extremes) -> dict[str, float]:
        """Largest stable steps [s] by what limits them."""
        grid, effects = self.plan.grid, self.plan.effects
        limits: dict[str, float] = {}
        if extremes.acceleration > 0:
            limits["force"] = 0.25 * math.sqrt(0.5 * grid.support_radius / extremes.acceleration)
        for effect in effects.values():
            limits |= effect.step_limits(grid, effects, extremes)
        if not limits:
            limits["resting"] = self.plan.scene.end_time or 1.0
        return limits

    # Inside

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
        if search.log.rebuilds:
            search.audit(
                self.fields["position"],
                self.fields["velocity"],
                self.previous_length,
                self._shared["neighbours"],
                self.steps,
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
