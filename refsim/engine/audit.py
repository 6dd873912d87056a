"""The audit of a run's mechanical energy.

It reads the state between two steps, on the host in float64, and changes nothing of the run.
"""

import math
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from refsim.core.energy import Amount, EnergyState, amount
from refsim.core.errors import RunStopped
from refsim.engine.driving import PUSH, Driving
from refsim.engine.launching import refresh
from refsim.engine.state import State
from refsim.scene.passes import accounts
from refsim.sph import SHIFT, acceleration_of

LEAP_FROGS = ("sph.kick_drift", "penetration.kick_drift")
ROUNDINGS = 4.0  # eps of the run's dtype in each term; a smaller change is rounding
KINETIC, COMPRESSION = "kinetic", "compression"
DRIVEN = "driving"  # part of the energy that is less the work of motions, moving faces and solids' pressure
SHIFTED = "shifting"  # part that is less what displacements beside dt v add to the energy of gravity


class AuditState(msgspec.Struct, frozen=True):
    """State of an audit between steps; energies in J (J/m in 2D), None before the first look."""

    start: dict[str, float] | None = None
    now: dict[str, float] = {}
    lowest: float | None = None
    turned_over: float = 0.0
    greatest_share: float = 0.0
    work: float = 0.0  # of what drives the run
    shifted: float = 0.0  # added to the energy of gravity by displacements beside dt v


class Auditor:
    """The audit of a run: its energies now, at their start, their lowest sum and what was turned over so far."""

    def __init__(self, run: State) -> None:
        plan = run.plan
        assert plan.scene.energy_audit is not None
        self.rule = plan.scene.energy_audit
        self.accounts = accounts(plan.grid, plan.effects)
        motion = plan.motion
        # Forces that follow the choice of the step are not known between two steps: what they act on is not advanced.
        late = {effect.name for effect, p in motion if effect is not None and "acceleration" in p.updates}
        self.staggered = any(p.operation in LEAP_FROGS for _, p in motion) and late <= {"shape_matching"}
        self.solids = bool(late)
        driven = bool(plan.scene.motion) or "wall_motion" in plan.shared
        driven = driven or any(p.operation == PUSH for _, p in plan.passes)
        self.driving = Driving(run) if driven else None
        pull = np.array(acceleration_of(plan.effects))
        self.pull = pull if SHIFT.name in plan.fields and pull.any() else None
        self.renew()

    def renew(self) -> None:
        """Begin anew at the next step: the state was set between two steps."""
        self.state = AuditState()
        self.shifted = 0.0
        if self.driving is not None:
            self.driving.renew()

    def uncounted(self) -> tuple[str, ...]:
        """What follows from no energy, by effect."""
        return tuple(f"{name}: {part}" for name, account in self.accounts.items() for part in account.uncounted)

    def energies(self, run: State) -> dict[str, Amount]:
        """All parts of the energy [J; J/m in 2D] in the present state, velocities at the positions' time.

        What drives the run brings a part of its own, less the work that it has done.
        """
        refresh(run)
        state = EnergyState(run)
        mass, velocity = state.field("mass"), state.field("velocity")
        if self.staggered:
            kick = 0.5 * run.previous_length * state.field("acceleration")
            if self.solids:
                from refsim.shape_matching.phases import FLUID

                kick[state.flags("phase") != FLUID] = 0.0
            velocity += kick
        kinetic = amount(0.5 * mass * (velocity**2).sum(1))
        parts = {KINETIC: kinetic._replace(size=kinetic.size + unsure(run, state, mass))}
        for account in self.accounts.values():
            parts |= {name: count(state) for name, count in account.parts.items()}
        if self.driving is not None:
            parts[DRIVEN] = amount(np.array(-self.driving.work))
        if self.pull is not None:
            parts[SHIFTED] = amount(np.array(-self.shifted))
        return parts

    def begin(self, run: State) -> None:
        """Note the energies that the run begins with, where they are not noted yet, and what drives the step."""
        if self.driving is not None:
            self.driving.begin(run)
        if self.state.start is None:
            self.look(run)

    def after_step(self, run: State) -> None:
        """Audit where it is due."""
        if self.driving is not None:
            self.driving.after_step(run)
        if self.pull is not None:
            self.shifted -= math.fsum(run.host("mass").astype(float) * (run.host(SHIFT.name).astype(float) @ self.pull))
        if run.steps % self.rule.every == 0:
            self.look(run)

    def look(self, run: State, note: bool = True) -> None:
        """Audit now. Raises RunStopped where the energy has grown; without `note` the audit's state is not changed."""
        before = self.state
        if before.start is None and not note:
            return
        with run.timings.of_host("energy_audit"):
            parts = self.energies(run)
        total = math.fsum(part.value for part in parts.values())
        where = f"In step {run.steps} at {run.time:.6g} s"
        values = {name: part.value for name, part in parts.items()}
        if not math.isfinite(total):
            raise RunStopped("non_finite", f"{where} the energy is not finite: {_words(values)}.")
        start = values if before.start is None else before.start
        # Liquid at rest has been compressed by its weight: all of that was turned over.
        begun = {name: 0.0 if name in (KINETIC, COMPRESSION) else v for name, v in start.items()}
        turned = math.fsum(abs(v - begun[name]) for name, v in values.items() if name not in (DRIVEN, SHIFTED))
        turned = max(before.turned_over, turned)
        lowest = total if before.lowest is None else min(before.lowest, total)
        rounding = (
            ROUNDINGS * float(np.finfo(run.plan.grid.dtype).eps) * math.fsum(part.size for part in parts.values())
        )
        rise = max(total - lowest - rounding, 0.0)
        share = rise / turned if turned > 0 else 0.0
        if note:
            self.state = AuditState(start, values, lowest, turned, max(before.greatest_share, share))
        if share > self.rule.bound:
            raise RunStopped(
                "energy_gained",
                f"{where} the energy stands {total - lowest:.4g} J above its lowest value, {share:.3g} of the"
                f" {turned:.4g} J turned over and more than the bound of energy_audit, {self.rule.bound:g}:"
                f" {_words(values)}. Take more viscosity, a shorter step or masses that differ less.",
            )

    def report(self) -> dict[str, Any]:
        """For the report of a run."""
        state = {name: getattr(self.state, name) for name in ("start", "now", "turned_over", "greatest_share")}
        return {"every": self.rule.every, "bound": self.rule.bound, **state, "uncounted": list(self.uncounted())}

    # In checkpoints

    def saved(self) -> AuditState:
        """Its state, from which it is restored bit for bit."""
        work = 0.0 if self.driving is None else self.driving.work
        return msgspec.structs.replace(self.state, work=work, shifted=self.shifted)

    def restore(self, state: AuditState) -> None:
        """Go on from what `saved` gave."""
        self.state, self.shifted = state, state.shifted
        if self.driving is not None:
            self.driving.work = state.work


def unsure(run: State, state: EnergyState, mass: NDArray) -> float:
    """Energy [J] over eps that solids get from the rounding of places to which they are pulled within a step."""
    if "shape_matching" not in run.plan.effects or not run.previous_length > 0:
        return 0.0
    from refsim.shape_matching.phases import FLUID

    held = state.flags("phase") != FLUID
    speed = state.field("position")[held] / run.previous_length  # times eps: a rounding of the place in one step
    return float(np.finfo(run.plan.grid.dtype).eps) * float(0.5 * (mass[held] * (speed**2).sum(1)).sum())


def _words(values: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:.4g} J" for name, value in values.items())
