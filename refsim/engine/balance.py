"""What is looked at on the host from time to time: totals that a run keeps, such as its heat, and what effects inspect.

A drift of a total beyond rounding is a note, a large one stops the run.
"""

import math
from typing import Any

import numpy as np

from refsim.core.capabilities import Inspects, KeepsBalance, effects_with
from refsim.core.errors import RunStopped
from refsim.engine.state import State

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
