"""What is looked at after steps: the liquid's density, what walls hold, what effects watch, totals kept."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.core.capabilities import Inspects, KeepsBalance, RunMonitor, effects_with
from refsim.core.errors import RunStopped
from refsim.engine.limits import StepOutcome
from refsim.engine.state import State
from refsim.engine.stepping import most_dense
from refsim.sph import CROWD, DENSE, LIQUID

STOPPED, ENOUGH = 2e-3, 100  # stops by planes over steps times particles that get a note, and least number of both
HELD = 0.3  # the same that stop the run


def watch(state: State, done: StepOutcome, field: Callable[[str], np.ndarray]) -> None:
    """Look at what a step did, and add notes to the run. Raises RunStopped where it cannot go on.

    field  values of a watched field after the step
    """
    if not math.isfinite(done.squared_displacement):
        raise RunStopped(
            "non_finite",
            f"Step {state.steps} to {state.time:.6g} s moved a particle to a place that is not finite.",
        )
    _note_density(state, done.dense)
    _note_stops(state)
    grid = state.plan.grid
    watching: list[Any] = [effect for effect in effects_with(state.plan.effects, RunMonitor) if effect.watched]
    for effect in watching:
        seen = {name: field(name) for name in effect.watched}
        stop = effect.verdict(grid, seen, done.length)
        if stop is not None:
            raise RunStopped(stop[0], f"In step {state.steps} to {state.time:.6g} s {stop[1]}")
        said = effect.warning(grid, seen)
        if said is not None:
            state.add_note(effect.name, f"{effect.name}: from step {state.steps} on, at {state.time:.6g} s, {said}")


def _note_density(state: State, dense: int) -> None:
    """Add a note to the run where more particles than may be are above the first bound of the liquid's density."""
    if dense > most_dense(state):
        message = f"{LIQUID}: from step {state.steps} on, at {state.time:.6g} s, {dense} of {state.count} particles"
        bound = f"more than {100 * CROWD:g} %, are denser than {DENSE:g} times the rest density"
        state.add_note(LIQUID, f"{message}, {bound}: take a larger sound_speed, or a shorter step with iisph")


def _note_stops(state: State) -> None:
    """Add a note where planes stop more particles than spray does; raise RunStopped where they hold the liquid.

    Between mirrored walls a film lies on planes, and so do solids: their runs are not stopped.
    """
    share = state.stopped_at_walls / (state.steps * state.count)
    if share <= STOPPED or min(state.steps, state.count) < ENOUGH:
        return
    extrapolated = state.lists.around_walls
    advice = "a smaller spacing" if extrapolated else "box_walls with model = 'extrapolated'"
    message = (
        f"up to step {state.steps}, at {state.time:.6g} s, planes have stopped {100 * share:.2g} % of the particles"
        f" in a step: the walls do not hold the liquid; take {advice}, or a smaller support_radius"
    )
    state.add_note("planes", message)
    if share > HELD and extrapolated and state.plan.grid.solids is None:
        raise RunStopped("held_by_planes", f"{message[0].upper()}{message[1:]}.")


# Totals that a run keeps


EVERY = 256  # steps between two looks, and at 1, 2, 4, ... steps
ROUNDINGS = 8.0  # roundings of a step that add up as a random walk; a smaller drift is rounding


class Balances:
    """Compares the totals of the effects that keep one with those at the start of the run.

    The start is the present state after resuming, and after a field was set.
    """

    def __init__(self, run: State) -> None:
        effects = run.plan.effects
        self.keeping: list[Any] = [
            e for e in effects_with(effects, KeepsBalance) if e.is_closed(run.plan.grid, effects)
        ]
        self.inspecting: list[Any] = effects_with(effects, Inspects)
        self.renew(run)

    def renew(self, run: State) -> None:
        """Count from the present state on."""
        self.begun = run.steps
        self.start = [effect.balance(run.host) for effect in self.keeping]

    def after_step(self, run: State) -> None:
        """Look from time to time. Raises RunStopped where a total has drifted by more than the effect allows, or for
        what an effect inspects.
        """
        taken = run.steps - self.begun
        if taken % EVERY == 0 or taken & (taken - 1) == 0:
            self.inspect(run)
            self.look(run)

    def inspect(self, run: State) -> None:
        """Let the effects look now. Raises RunStopped as `after_step`."""
        for effect in self.inspecting:
            finding = effect.inspected(run.plan.grid, run.host)
            if finding is None:
                continue
            reason, message = finding
            if reason:
                raise RunStopped(reason, f"In step {run.steps} to {run.time:.6g} s {message}.")
            run.add_note(
                f"{effect.name} inspection", f"{effect.name}: in step {run.steps}, at {run.time:.6g} s, {message}"
            )

    def look(self, run: State) -> None:
        """Compare the totals now. Raises RunStopped as `after_step`."""
        for effect, start in zip(self.keeping, self.start):
            now = effect.balance(run.host)
            drift = now.total - start.total
            eps = float(np.finfo(run.plan.grid.dtype).eps)
            rounding = ROUNDINGS * eps * math.sqrt(max(run.steps - self.begun, 1)) * max(start.size, now.size)
            if not abs(drift) > rounding:
                continue
            compared = max(start.exchangeable, math.sqrt(eps) * start.size)  # of one temperature that is rounding
            share = abs(drift) / compared if compared > 0 else math.inf
            message = (
                f"{effect.name}: in step {run.steps} at {run.time:.6g} s the {effect.balanced} has changed by"
                f" {drift:.3g} J, {100 * share:.2g} % of what can be exchanged, although nothing enters or leaves"
            )
            if 0 < effect.largest_drift < share:
                raise RunStopped(effect.stops_as, f"{message}: {effect.remedy}.")
            run.add_note(f"{effect.name} balance", f"{message}; rounding explains {rounding:.2g} J: {effect.remedy}.")
