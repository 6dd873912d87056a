"""What hard cases and stability maps are made of: a trial that notes what held and how it ended, and a bisection.

A hard case is a function of a `Trial`, marked `hard_case`, that a check of that kind names. `validation.judging`
performs and judges it.
"""

import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from refsim import Plan, Scene, Simulation
from refsim.core.errors import InputError, RunStopped
from refsim.engine.conserved_totals import check_particles
from refsim.scene.plan import make_plan
from validation.checks import FAILS, PASS, REFUSED, STOPPED, WARNED
from validation.results import Result
from validation.running import Context, momenta, search_log

STANDING = "brakes free rotation"  # of the note on every free liquid with J(11): it foresees no other failure
ROUNDINGS = 32  # of the dtype: what a sum of equal and opposite pair forces may leave of a momentum


@dataclass(frozen=True)
class Cell:
    """One cell of a map: `function(context, backend, **parameters)` returns a Limit's result.

    row, column  where it stands in the picture
    """

    row: str
    column: str
    function: Callable[..., Result]
    parameters: Mapping[str, Any]
    seconds: float = 10.0

    @property
    def key(self) -> str:
        """The cell's name as a part of a file name."""
        name = f"{self.row} {self.column}".lower()
        return "_".join("".join(c if c.isalnum() else " " for c in name).split())


@dataclass(frozen=True)
class StabilityMap:
    """How far a setting can go, measured by bisection, against the runner's own limit.

    name      of the picture; what follows stands in the `[map.NAME]` of the experiment's `expected.toml`
    quantity  that is bisected, with its unit
    criterion what "stable" means in it
    advice    one sentence: what a user should choose
    """

    name: str
    title: str
    quantity: str
    criterion: str
    advice: str
    cells: tuple[Cell, ...]


class Trial:
    """A hard case while it runs.

        @hard_case
        def name(trial: Trial, speed: float) -> None:
            simulation = trial.start(scene)
            trial.advance(simulation, until=1.0)
            trial.check("...", value, at_most=bound)

    Its outcome is "pass" where every check held; "refused" after an InputError; "stopped: <reason>" after a
    RunStopped; "warned: <checks>" where the run itself said beforehand that they would not hold, and they did not;
    "fails: <checks>" where any other did not hold, whatever else happened.
    """

    def __init__(self, context: Context, backend: str) -> None:
        self.context, self.backend = context, backend
        self.checks: dict[str, dict[str, Any]] = {}
        self.shown: dict[str, Any] = {}
        self.arrays: dict[str, np.ndarray] = {}
        self.noted: list[str] = []  # checks that the run's own notes said would not hold
        self.ended, self.message = PASS, ""

    @contextmanager
    def ending(self) -> Iterator[None]:
        """Note how what stands inside ends; a stop and a refusal are outcomes, not errors."""
        try:
            yield
        except InputError as error:
            self.ended, self.message = REFUSED, str(error)
        except RunStopped as stop:
            self.ended, self.message = f"{STOPPED}: {stop.reason}", str(stop)

    def start(self, scene: Scene | Plan, backend: str | None = None) -> Simulation:
        """A simulation of the scene."""
        return self.context.simulation(scene, backend or self.backend)

    def advance(
        self, simulation: Simulation, until: float = math.inf, steps: int | None = None,
        watch: Callable[[Simulation], None] | None = None, every: int = 1,
    ) -> None:  # fmt: skip
        """Step to a time [s] or for a number of steps; `watch` sees the start, every so many steps, and the end."""
        last = math.inf if steps is None else simulation.steps + steps
        if watch is not None:
            watch(simulation)
        while simulation.time < until and simulation.steps < last:
            simulation.step()
            if simulation.steps % 16 == 0:
                self.context.progress(max(simulation.time / until, simulation.steps / last))
            if watch is not None and simulation.steps % every == 0:
                watch(simulation)
        self.account(simulation)

    def account(self, simulation: Simulation, isolated: bool = False) -> None:
        """Checks of every run: all particles there, all finite, no neighbour missed; `isolated`: momentum kept."""
        try:
            check_particles(simulation)
            lost = 0
        except RunStopped:
            lost = 1
        self.check("no particle is lost", lost, equals=0)
        state = [simulation.field(name) for name in ("position", "velocity")]
        self.check("values that are not finite", sum(int((~np.isfinite(a)).sum()) for a in state), equals=0)
        self.check("missed neighbours", search_log(simulation).get("missed_neighbours", 0), equals=0)
        if isolated:
            now = momenta(simulation)
            eps = float(np.finfo(simulation.plan.grid.dtype).eps)
            scale = max(now["momentum_scale"], self.shown.get("momentum scale", 0.0))
            share = float(np.linalg.norm(now["momentum"])) / scale if scale > 0 else 0.0
            self.check("momentum over sum of m |v|", share, at_most=ROUNDINGS * eps)

    def check(
        self, what: str, value: float, at_most: float | None = None, at_least: float | None = None,
        equals: float | None = None,
    ) -> bool:  # fmt: skip
        """Note a number that must keep its bound; one checked again keeps the worse of its values."""
        rules = {"at most": at_most, "at least": at_least, "exactly": equals}
        ((rule, bound),) = ((rule, bound) for rule, bound in rules.items() if bound is not None)
        value = float(value)
        held = {"at most": value <= bound, "at least": value >= bound, "exactly": value == bound}[rule]
        before = self.checks.get(what)
        if before is None or (before["held"] and (not held or _worse(rule, value, before["value"]))):
            self.checks[what] = {"value": value, "rule": rule, "bound": float(bound), "held": bool(held)}
        return bool(held)

    def check_unless_noted(self, simulation: Simulation, word: str, what: str, value: float, **bound: float) -> None:
        """Check a number that may miss its bound where one of the run's notes has `word`."""
        held = self.check(what, value, **bound)
        if not held and any(word in note and STANDING not in note for note in simulation.notes):
            self.noted.append(what)

    def show(self, what: str, value: Any) -> None:
        """Note a number that has no bound."""
        self.shown[what] = value

    @property
    def outcome(self) -> str:
        """How it ended, in the words of the module's table."""
        missed = [what for what, check in self.checks.items() if not check["held"]]
        unforeseen = [what for what in missed if what not in self.noted]
        if unforeseen:
            return f"{FAILS}: {', '.join(unforeseen)}"
        return f"{WARNED}: {', '.join(missed)}" if missed and self.ended == PASS else self.ended

    def result(self) -> Result:
        """All that was noted."""
        values = {"outcome": self.outcome, "message": self.message, "checks": self.checks, "shown": self.shown}
        return Result(values, self.arrays)


def unguarded(scene: Scene, stable: float = 1e-9) -> Plan:
    """The plan of a scene with a fixed step, however long: a scene refuses one beyond what is `stable` [s]."""
    return dataclasses.replace(make_plan(msgspec.structs.replace(scene, step=stable)), scene=scene)


def hard_case(function: Callable[..., None]) -> Callable[..., Result]:
    """A function of a trial as a run: a stop and a refusal end it, and its result is what the trial noted."""

    @functools.wraps(function)
    def performed(context: Context, backend: str, *given: Any, **named: Any) -> Result:
        trial = Trial(context, backend)
        with trial.ending():
            function(trial, *given, **named)
        return trial.result()

    _, *parameters = inspect.signature(function).parameters.values()
    lead = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in ("context", "backend")]
    performed.__signature__ = inspect.Signature([*lead, *parameters])  # type: ignore[attr-defined]
    return performed


def _worse(rule: str, value: float, before: float) -> bool:
    return {"at most": value > before, "at least": value < before, "exactly": False}[rule]


@dataclass(frozen=True)
class Limit:
    """What a bisection found: the largest value that was stable, the smallest tried above it that was not (infinite
    where all were stable), why that was not, and every value tried with its answer ("" where stable)."""

    largest: float
    failing: float
    why: str
    tried: list[tuple[float, str]]

    def result(self, runner: float, **more: Any) -> Result:
        """As a cell's result; `runner` is the value up to which the runner lets it pass without a word."""
        values = {"largest": self.largest, "failing": self.failing, "why": self.why, "tried": self.tried}
        return Result({**values, "runner": runner, **more})


def largest_stable(
    trouble: Callable[[float], str], first: float, least: float, most: float, factor: float = 1.1
) -> Limit:
    """The largest value between `least` and `most` for which `trouble(value)` is "", to a factor, from a first guess.

    Doubles or halves from `first` until the answer changes, then halves the gap in the logarithm. Supposes that a
    value above one that troubles troubles as well; `tried` shows every answer. 0 where even `least` troubles.
    """
    answers: dict[float, str] = {}

    def ask(value: float) -> str:
        if value not in answers:
            answers[value] = trouble(value)
        return answers[value]

    low, high = 0.0, math.inf
    value = first
    while True:
        if ask(value):
            high = min(high, value)
            if value <= least:
                break
            following = max(0.5 * value, least)
        else:
            low = max(low, value)
            if value >= most:
                break
            following = min(2.0 * value, most)
        if low > 0 and high < math.inf:
            break
        value = following
    while low > 0 and high < math.inf and high / low > factor:
        middle = math.sqrt(low * high)
        if ask(middle):
            high = middle
        else:
            low = middle
    return Limit(low, high, answers.get(high, ""), sorted(answers.items()))


def at_step(plan: Plan, factor: float) -> Plan:
    """The plan with `factor` times the stable step, also above 1, which scenes refuse."""
    scene = msgspec.structs.replace(plan.scene)
    msgspec.structs.force_setattr(scene, "step_factor", factor)
    return dataclasses.replace(plan, scene=scene)


def silent_up_to(made: Callable[[float], Scene], least: float, most: float, but: tuple[str, ...] = ()) -> float:
    """The largest value between `least` and `most` whose scene the runner neither refuses nor says anything about;
    notes with any of the words `but`, which the value does not change, are left out."""

    def said(value: float) -> str:
        try:
            notes = make_plan(made(value)).notes
            return " ".join(note for note in notes if not any(word in note for word in (STANDING, *but)))
        except InputError as error:
            return str(error)

    return largest_stable(said, least, least, most, factor=1.02).largest
