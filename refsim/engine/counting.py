"""The density that a liquid's particles tell beside that which is counted of them.

A density that is advanced follows the velocities, not the places: it does not see particles that gather or part. Their
told volumes m/rho are summed on cells (`refsim.scene.counting`): those inside the liquid are filled with 1 where it is
true. Cells at a free surface do not count; walls and solids fill theirs. It is computed on the host and changes nothing
of the run.
"""

import math
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

from refsim.core.capabilities import Inspects, KeepsBalance, RunMonitor, effects_with
from refsim.core.errors import RunStopped
from refsim.engine.limits import StepOutcome
from refsim.engine.state import State
from refsim.engine.stepping import most_dense
from refsim.scene.counting import Cells
from refsim.shape_matching.phases import FLUID
from refsim.sph import CROWD, DENSE, LIQUID, liquid_of

EVERY = 256  # steps between two looks; at the density each is as dear as up to 8 of a CPU's
SELDOM = 32  # times as many on a GPU at most, for which a look is as long as 100 to 250 steps
LOOKED = "counted density"  # name of its remark
WHOLE = 0.8  # share from which a cell is full of liquid: sheets from four spacings on have such cells
LEAST = 16  # cells inside the liquid without which nothing is said
NOTED = 0.02  # difference of the counted density from the told one, over it, that has a note
# Above it the run stops. Liquid that stays whole was found to reach 0.09 (a splash of 12 s with shifting); a rotating
# patch that negative pressures tear into strings passes 0.13 after 2.0 rad, 0.29 after 2.5 and 0.49 after 3.0.
LARGEST = 0.25


class Counted(msgspec.Struct, frozen=True):
    """Density of the particles inside the liquid, told and counted [kg/m^dim], and the number of cells there.

    difference     counted over told, less 1
    least, most    the same of the 1 % of the cells with the least, and with the largest
    """

    told: float
    counted: float
    difference: float
    least: float
    most: float
    cells: int


class Counting:
    """Compares the counted density of an advanced one from time to time.

    greatest  the difference farthest from 0 so far; None before the first look
    latest    what the latest look has found
    before    difference of the look before, None without one: a gap of a few spacings through which liquid falls on
              liquid counts as liquid that lacks particles, and is gone at the next look
    again     step of a look in between, after one that found a difference
    """

    def __init__(self, run: State) -> None:
        self.acts = "advanced_excess" in run.fields
        self.every = EVERY * (min(SELDOM, 1 + run.plan.grid.count // 512) if run.backend.name == "cuda" else 1)
        self.greatest: float | None = None
        self.latest: Counted | None = None
        self.before: float | None = None
        self.again = 0

    def after_step(self, run: State) -> None:
        """Look where it is due. Raises RunStopped where told and counted density are far apart at two looks in turn."""
        if self.acts and (run.steps % self.every == 0 or run.steps == self.again):
            self.before = self.before or 0.0
            note = self.judged(run)
            if self.latest is not None and abs(self.latest.difference) > abs(self.greatest or 0.0):
                self.greatest = self.latest.difference
            if note:
                run.add_note(LOOKED, note)

    def judged(self, run: State) -> str:
        """Look now: a note, or "". Raises RunStopped as `after_step`; nothing that a checkpoint holds is changed."""
        if not self.acts:
            return ""
        with run.timings.of_host("counting"):
            counts = self.latest = counted(run)
        now = 0.0 if counts is None else counts.difference
        before, self.before = now if self.before is None else self.before, now
        lasting = min(abs(before), abs(now)) if before * now > 0 else 0.0
        self.again = run.steps + EVERY if abs(now) > NOTED else 0
        if counts is None or lasting <= NOTED:
            return ""
        side = "above" if counts.difference > 0 else "below"
        message = (
            f"{LIQUID}: in step {run.steps} at {run.time:.6g} s a density of {counts.counted:.4g}"
            f" kg/m^{run.plan.grid.dim} is counted inside the liquid, {abs(counts.difference):.1%} {side} the advanced"
            " one: volumes and levels are off by as much; "
        )
        if lasting > LARGEST:
            raise RunStopped("miscounted", f"{message}add particle_shifting, or set density = 'summation'.")
        return f"{message}restoring brings both together, particle_shifting keeps the particles even"

    def report(self) -> dict[str, Any] | None:
        """For the report of a run."""
        if not self.acts:
            return None
        latest = {} if self.latest is None else msgspec.structs.asdict(self.latest)
        known = [d for d in (self.greatest, latest.get("difference")) if d is not None]
        return latest | {"greatest_difference": max(known, key=abs, default=None)}


def counted(run: State) -> Counted | None:
    """Told and counted density now; None where no density is advanced, or too little liquid has none but liquid
    around."""
    if "advanced_excess" not in run.fields:
        return None
    grid = run.plan.grid
    place, mass, excess = (run.host(name).astype(float) for name in ("position", "mass", "advanced_excess"))
    rest: Any = liquid_of(run.plan.effects).rest_density
    rest = run.host("rest_density").astype(float) if "rest_density" in run.fields else rest
    volume = mass / (rest + excess)
    wet = run.host("phase") == FLUID if "phase" in run.fields else np.ones(grid.count, bool)
    walls = run.plan.walls
    if walls is not None:
        place = np.concatenate([place, grid.local(walls.position)])
    cells = Cells(place, grid)
    left = 1 - (0.0 if walls is None else cells.filled(walls.volume, grid.count))
    if not wet.all():
        left = left - cells.filled(np.where(wet, 0.0, volume))
    told = cells.filled(np.where(wet, volume, 0.0))
    left = np.broadcast_to(left, told.shape)
    inside = cells.inside(np.flatnonzero(wet), left <= 0.5, told >= WHOLE * left)
    kept, of = np.flatnonzero(inside), wet & inside[cells.cell_of[: grid.count]]
    if len(kept) < LEAST or not of.any():
        return None
    density, shares = mass[of].sum() / volume[of].sum(), told[kept] / left[kept] - 1
    few = max(1, len(kept) // 100)
    ordered = np.sort(shares)
    difference = float(told[kept].sum() / left[kept].sum() - 1)
    return Counted(
        float(density), float(density * (1 + difference)), difference, float(ordered[:few].mean()),
        float(ordered[-few:].mean()), len(kept),
    )  # fmt: skip


# What is looked at after steps: density, what walls hold, what effects watch, totals kept


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
