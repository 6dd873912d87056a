"""One step's length and motion: chosen on the host, or on the device so that a whole step is one CUDA graph."""

import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn

import numpy as np

from refsim.core.capabilities import RunMonitor, effects_with
from refsim.core.effect import Extremes, Pass
from refsim.core.errors import RunStopped
from refsim.engine import launching
from refsim.engine.binding import Accesses, accesses, needed_before
from refsim.engine.limits import StepOutcome, stable_steps
from refsim.engine.neighbour_lists import look_ahead
from refsim.engine.state import Calls, State
from refsim.sph import CROWD

SMALLEST_STEP = 1e-6  # share of the first step below which the run is taken to have diverged


def advance(state: State) -> StepOutcome:
    """Launch the passes of a step one by one, choose its length, and move the particles.

    Raises RunStopped, with the state as it was, where that is impossible.
    """
    for name, call in state.begin_calls:
        state.timings.run(name, call)
    for _ in launching.launch(state):
        pass
    extremes = checked_extremes(state)
    limits = stable_steps(state.limits, extremes)
    limiter = min(limits, key=lambda name: limits[name])
    length = float(limits[limiter] * state.plan.scene.step_factor)
    if state.plan.scene.step > 0:
        length, limiter = state.plan.scene.step, "fixed"
    if state.first_length is None:
        state.first_length = length
    if not length > SMALLEST_STEP * state.first_length:
        _too_small(state, limiter, length)
    steps = [0.5 * (state.previous_length + length), length]
    state.backend.assign(state.timestep, np.array(steps, dtype=state.plan.grid.dtype))
    for name, call in state.motion_calls:
        state.timings.run(name, call)
    return _advanced(state, length, limiter, limits, extremes, *map(float, state.backend.host(state.displacement)))


def checked_extremes(state: State) -> Extremes:
    """Largest speed and acceleration. Raises RunStopped where one is not finite or the run has diverged."""
    state.timings.run("sph.extremes", state.extremes_call)
    speed2, force2, broken, *others = (float(x) for x in state.backend.host(state.extremes))
    extremes = Extremes(math.sqrt(speed2), math.sqrt(force2), *others)
    check_extremes(state, int(broken), extremes)
    return extremes


def check_extremes(state: State, broken: int, extremes: Extremes) -> None:
    """Raise RunStopped where `broken` particles have no finite speed or acceleration, or one is too fast."""
    where = f"In step {state.steps} at {state.time:.6g} s"
    if broken:
        what = "a velocity or an acceleration"
        if "temperature" in state.fields:
            what = "a velocity, an acceleration or a temperature"
        raise RunStopped("non_finite", f"{where} {broken} particles have {what} that is not finite.")
    if extremes.speed > state.greatest_speed:
        raise RunStopped(
            "diverged",
            f"{where} a particle moves with {extremes.speed:.4g} m/s, beyond the {state.greatest_speed:.4g} m/s up"
            " to which the scene's equations hold: take a smaller step or a larger sound speed.",
        )
    if extremes.excess > 0:
        low, high = state.host("temperature_range")
        raise RunStopped(
            "temperature_out_of_range",
            f"{where} a temperature is {extremes.excess:.3g} K beyond the {low:.6g} to {high:.6g} deg C that conduction"
            " from the start's temperatures can reach: take a shorter step or another scheme of heat_conduction.",
        )
    if extremes.crushed > most_dense(state):
        bound = state.plan.shared["density_bounds"].crushed
        raise RunStopped(
            "compressed",
            f"{where} {extremes.crushed:.0f} of {state.plan.grid.count} particles are denser than {bound:g} times"
            " the rest density, where the equation of state does not hold: take a larger sound_speed, a shorter step"
            " or weaker forces, or raise density_bound of weakly_compressible.",
        )


def most_dense(state: State) -> float:
    """Number of particles that may exceed a bound of the density."""
    return CROWD * state.plan.grid.count


def _too_small(state: State, limiter: str, length: float) -> NoReturn:
    """Raise RunStopped for a step below SMALLEST_STEP of the first one."""
    raise RunStopped(
        "step_too_small",
        f"In step {state.steps} at {state.time:.6g} s the {limiter} limit allows a step of {length:.3g} s,"
        f" below {SMALLEST_STEP:g} of the first one: the run diverges.",
    )


def _advanced(
    state: State, length: float, limiter: str, limits: dict[str, float], extremes: Extremes, squared: float,
    stopped: float, squared_shift: float,
) -> StepOutcome:  # fmt: skip
    """What a step of this length did; the last three as operation sph.kick_drift gives them."""
    gained = 0.5 * (state.previous_length + length) * extremes.acceleration
    shifted = math.sqrt(squared_shift)
    moved = (extremes.speed + gained) * length + shifted
    return StepOutcome(length, limiter, limits, moved, shifted, gained, squared, int(stopped), int(extremes.dense))


class DeviceStepper:
    """Chooses the step on the device: passes, choice and motion are one CUDA graph, which sends the clock back.

    Passes that need nothing of each other are branches of the graph. Where nothing but the state goes into the forces,
    and the list will probably serve, those of the next step are launched behind a step: the device then works on while
    the host looks at what the step did.

    In a run that is profiled they are launched one by one, each with a wait behind it; the programs are the same.
    """

    def __init__(self, state: State) -> None:
        from refsim.backends import device

        s = self.state = state
        self.device = device
        self.names = list(s.limits)
        self.limits = s.backend.asarray(np.array(list(s.limits.values()), dtype=np.float64))
        self.clock = s.backend.zeros(device.CLOCK_ROWS, np.float64)
        self.mirror, self.mark = device.PinnedCopy(self.clock), device.Event()
        watched = {name for effect in effects_with(s.plan.effects, RunMonitor) for name in effect.watched}
        self.mirrors = {name: device.PinnedCopy(s.fields[name]) for name in sorted(watched)}
        self.in_step_with = -1  # the step up to which the device's clock has counted
        self.profiled = s.timings.wait is not None
        whole = not (self.profiled or any(effect.host_in_step for effect in s.plan.effects.values()))
        added = [p for _, p in (*s.plan.passes, *s.plan.motion) if "acceleration" in p.written]  # else it stays zero
        self.pushed = bool(added) and not any("acceleration" in p.writes for p in added)
        self.calls, self.touches = self._sequence()
        choice = [name for name, _ in self.calls].index("choose_step")
        self.bindings = s.bindings  # for which the calls were recorded
        self.hosted = {name for e in s.plan.effects.values() for name in e.host_passes} if whole else set()
        written = {name for _, p in s.force_passes for name in p.written}
        kept = any(f.state for name, f in s.plan.fields.items() if name in written)  # what outlives a step changes
        apart = self.hosted or s.plan.begin or s.motions or s.order.attended or kept
        self.foresees = whole and not apart
        self.recorded, self.forces, self.motion = (
            device.CudaGraph(partial(self._launch, part), whole)
            for part in (slice(None), slice(choice), slice(choice, None))
        )
        self.parts = self._parts()
        self.version: Any = None  # of the arrays that the graphs behind a pass of the host take

    def _renew(self) -> None:
        """The arrays have changed: record the step anew."""
        self.bindings, self.state.foreseen = self.state.bindings, False
        self.calls, self.touches = self._sequence()
        self.recorded, self.forces, self.motion = (r.renewed() for r in (self.recorded, self.forces, self.motion))
        self.parts = self._parts()

    def _parts(self) -> list[Callable[[], Any]]:
        """A step with passes of the host: these, and graphs of what stands between them."""
        names, first = [name for name, _ in self.calls], 0
        parts: list[Callable[[], Any]] = []
        for k in [k for k, name in enumerate(names) if name in self.hosted]:
            parts += [self.device.CudaGraph(partial(self._launch, slice(first, k))), self.calls[k][1]]
            first = k + 1
        return [*parts, self.device.CudaGraph(partial(self._launch, slice(first, None)))] if parts else []

    def _launch_parts(self) -> None:
        """The parts; those behind a pass of the host are recorded anew where it says that arrays are others."""
        for k, part in enumerate(self.parts):
            version = part()
            if version is not None and version != self.version:
                self.version = version
                self.parts[k + 1 :] = self._parts()[k + 1 :]

    def watched(self, name: str) -> np.ndarray:
        """A watched field after the step, which sent it with the clock."""
        return self.mirrors[name].values

    def advance(self) -> StepOutcome:
        """One step. Raises RunStopped, with the state as it was, where that is impossible."""
        s, device = self.state, self.device
        if self.bindings != s.bindings:
            self._renew()
        if self.in_step_with != s.steps:
            self._set_clock()
        began = time.perf_counter()
        if not self.recorded.called:
            self._launch_each()  # each program's first call is timed, because it compiles
            self.recorded.called = True
        elif self.parts:
            self._launch_parts()
        elif s.foreseen:
            self.motion()
        else:
            self.recorded()
        self.mark.set()
        foresees = not look_ahead(s) and self.foresees
        if foresees:
            self.forces()  # of the next step, while the host looks at this one
        self.mark.wait()
        clock = self.mirror.values
        if not self.profiled:
            s.timings.add("step", time.perf_counter() - began)
        seen = (device.SPEED, device.ACCELERATION, device.RATE, device.EXCESS, device.DENSE, device.CRUSHED)
        extremes = Extremes(*(float(clock[row]) for row in seen))
        length, limiter = float(clock[device.LENGTH]), int(clock[device.LIMITER])
        name = "fixed" if limiter < 0 else self.names[limiter]
        reason = int(clock[device.REASON])
        s.foreseen = foresees
        if reason:
            self.in_step_with = -1
            check_extremes(s, int(s.backend.host(s.extremes)[2]), extremes)
            _too_small(s, name, length)
        s.first_length = float(clock[device.FIRST])
        self.in_step_with = s.steps + 1
        limits = stable_steps(s.limits, extremes)
        return _advanced(
            s, length, name, limits, extremes, *map(float, clock[[device.WAY, device.STOPPED, device.SHIFTED]])
        )

    def _set_clock(self) -> None:
        """Give the device the host's clock: at the start, and after resuming."""
        s, device = self.state, self.device
        values = np.zeros(device.CLOCK_ROWS)
        values[[device.TIME, device.PREVIOUS, device.FIRST]] = s.time, s.previous_length, s.first_length or 0.0
        s.backend.assign(self.clock, values)

    def _launch(self, part: slice) -> None:
        if self.profiled:
            self._launch_each()
        else:
            self.device.launch_after([call for _, call in self.calls[part]], needed_before(self.touches[part]))
        self.state.scratch.unchanged(False)

    def _launch_each(self) -> None:
        for name, call in self.calls:
            if name:
                self.state.timings.run(name, call)
            else:  # no operation of the step
                call()
        self.state.scratch.unchanged(False)

    def _sequence(self) -> tuple[Calls, list[Accesses | None]]:
        """All that a step launches, in order, and what each launch touches."""
        s, plan, backend = self.state, self.state.plan, self.state.backend.name
        forces = [(name, call, p) for (name, rare, call), (_, p) in zip(s.force_calls, s.force_passes) if not rare]
        fields = frozenset({"acceleration", *_reduced([s.extremes_call])})
        motion = [(name, _cleared(call)) for name, call in s.motion_calls]
        in_motion = frozenset(_reduced([call for _, call in s.motion_calls]))
        steps: list[tuple[str, Callable[[], None], Accesses | None]] = [
            *((*call, accesses(p, backend)) for call, (_, p) in zip(s.begin_calls, plan.begin)),
            ("", self._clear, Accesses(fields, fields)),
            *((name, call, accesses(p, backend)) for name, call, p in forces),
            ("sph.extremes", _cleared(s.extremes_call), accesses(Pass("sph.extremes"), backend)),
            ("choose_step", self._choose, Accesses(frozenset({"extremes", "timestep"}), frozenset({"timestep"}))),
            *([("", self._clear_motion, Accesses(in_motion, in_motion))] if in_motion else []),
            *((*call, accesses(p, backend)) for call, (_, p) in zip(motion, plan.motion)),
            ("send_clock", self._send, None),
        ]
        return [(name, call) for name, call, _ in steps], [what for *_, what in steps]

    def _clear(self) -> None:
        s = self.state
        s.scratch.unchanged(True)  # in what is launched behind this, up to the motion
        if self.pushed:
            self.device.fill(s.fields["acceleration"], 0)
        self._fill_least([s.extremes_call])

    def _clear_motion(self) -> None:
        """Not with `_clear`, which may be launched for the next step: what this one reduced could not be read then."""
        self._fill_least([call for _, call in self.state.motion_calls])

    def _fill_least(self, calls: list[Callable[[], None]]) -> None:
        for into in _reduced(calls).values():
            self.device.fill(*into)

    def _choose(self) -> None:
        s, scene = self.state, self.state.plan.scene
        self.device.choose_step(
            s.extremes, self.limits, scene.step_factor, scene.step, SMALLEST_STEP, s.greatest_speed,
            most_dense(s), s.timestep, self.clock,
        )  # fmt: skip

    def _send(self) -> None:
        self.device.send_clock(self.state.displacement, self.clock, self.mirror.there)
        for mirror in self.mirrors.values():
            mirror.send()


def _reduced(calls: list[Callable[[], None]]) -> dict[str, tuple[Any, float]]:
    """What the calls reduce into, by name, with the least number that must stand there before."""
    return {c.func.into: (c.args[-1], c.func.least) for c in calls if _cleared(c) is not c}  # type: ignore[attr-defined]


def _cleared(call: Callable[[], None]) -> Callable[[], None]:
    """The call without filling its outputs with zeros, where its program has a kernel that does only the rest.

    At the start of a step the zeros are written beside other launches, in front of a kernel they would delay it.
    """
    program = getattr(call, "func", None)
    if not hasattr(program, "cleared"):
        return call
    return partial(program.cleared, *call.args)  # type: ignore[attr-defined,union-attr]
