"""Campaigns: scenes drawn by Hypothesis, held to laws, in one table of laws by effects."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import hypothesis

from refsim.core.effect import EFFECTS
from refsim.core.errors import InputError, RunStopped
from refsim.scene.files import scene_to_toml
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from validation.laws.laws import LAWS, Found
from validation.laws.scenes import Drawn, drawn

OUTCOMES = ("held", "noted", "broken", "refused", "stopped")
TURN = 10  # scenes of a turn
SMALLER = 30  # trials that make a scene smaller


class Broken(Exception):
    """A law that does not hold, without a note."""


class Enough(BaseException):
    """A scene was made smaller for long enough."""


class Tally(NamedTuple):
    """Outcomes by (law, effect), reasons of refusals, and the smallest scene of each break."""

    table: dict[tuple[str, str], Counter[str]]
    refusals: Counter[str]
    breaks: dict[str, str]


def campaign(laws: list[str], effects: list[str | None], seconds: float, seed: int, backend: str) -> Tally:
    """Turns over all laws and effects until the processor time is over."""
    tally = Tally(defaultdict(Counter), Counter(), {})
    asked: Iterator[tuple[str, Callable[..., Any], str | None]]
    until, turn = time.process_time() + seconds, 0
    while turn == 0 or time.process_time() < until:
        asked = ((name, each, effect) for effect in effects for name in laws for each in LAWS[name])
        for name, each, effect in asked:
            if turn and time.process_time() > until:
                break
            if f"{name}/{each.__name__}" not in tally.breaks:
                _turn(name, each, effect, seed + turn, backend, tally)
        turn += 1
    return tally


def _turn(name: str, law: Callable[..., Any], effect: str | None, seed: int, backend: str, tally: Tally) -> None:
    """One law on some scenes; a scene that breaks it is made smaller SMALLER times at most."""
    key = f"{name}/{law.__name__}" + (f" ({effect})" if effect else "")
    broken: list[tuple[int, str]] = []
    after = 0

    @hypothesis.settings(
        max_examples=TURN if effect is None else 5, deadline=None, database=None,
        suppress_health_check=list(hypothesis.HealthCheck), report_multiple_bugs=False,
    )  # fmt: skip
    @hypothesis.seed(seed)
    @hypothesis.given(drawn(effect))
    def trials(scene: Drawn) -> None:
        nonlocal after
        after += bool(broken)
        if after > SMALLER:
            raise Enough
        outcome, found = judged(law, scene, backend, tally.refusals)
        if not broken:
            for acting in scene.scene.effects:
                tally.table[name, acting.name][outcome] += 1
        if outcome == "broken":
            words = f"{found.how}: found {found.value:.3g}, bound {found.bound:.3g}"
            size = len(scene.scene.fluid[0].position) + 100 * len(scene.scene.effects)
            broken.append((size, f"{words}\n{_written(scene, found.scene)}"))
            raise Broken

    with contextlib.suppress(Broken, Enough, hypothesis.errors.Flaky):
        trials()
    if broken:
        tally.breaks.setdefault(key, min(broken)[1])


def _written(scene: Drawn, other: Scene | None) -> str:
    """The scene as TOML without what is usual, its particles as the cells and the seed that they were drawn from."""
    usual = set(scene_to_toml(Scene(spacing=1.0, support_radius=2.0, fluid=())).splitlines())
    text = scene_to_toml(other or scene.scene)
    lines = [
        line
        for line in text.splitlines()
        if not line.startswith(("position =", "velocity = [[")) and (line not in usual or not line)
    ]
    return "\n".join([f"# cells {scene.cells}, seed {scene.seed}", *lines])


def judged(law: Callable[..., Any], scene: Drawn, backend: str, refusals: Counter[str]) -> tuple[str, Found]:
    """(outcome, what was found) of a law in a scene."""
    nothing = Found(math.nan, math.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = law(scene, backend)
            if found is None:
                return "not applied", nothing
            if found.held:
                return "held", found
            return ("noted" if make_plan(found.scene or scene.scene).notes else "broken"), found
        except InputError as error:
            refusals[str(error).split(";")[0][:120]] += 1
            return "refused", nothing
        except RunStopped as error:
            return "stopped", nothing._replace(how=str(error))
        except Exception:  # any other error is a finding
            return "broken", Found(math.nan, 0.0, traceback.format_exc(limit=-3))


def table(tally: Tally) -> str:
    """Outcomes, a line a law."""
    lines = [f"{'law':22}" + "".join(f"{word:>9}" for word in OUTCOMES)]
    laws = sorted({law for law, _ in tally.table})
    for law in laws:
        counts: Counter[str] = Counter()
        for (other, _), found in tally.table.items():
            counts += found if other == law else Counter()
        lines.append(f"{law:22}" + "".join(f"{counts[word]:9}" for word in OUTCOMES))
    return "\n".join(lines)


def add_options(made: argparse.ArgumentParser) -> None:
    """The command line."""
    made.add_argument("--minutes", type=float, default=10.0, help="processor minutes (10)")
    made.add_argument("--seed", type=int, default=1, help="of the first turn (1)")
    made.add_argument("--law", nargs="+", choices=sorted(LAWS), default=sorted(LAWS), help="all by default")
    made.add_argument("--effect", nargs="+", choices=sorted(EFFECTS), help="scenes with these effects alone")
    made.add_argument("--backend", default="numpy", help="numpy, cpu or cuda (numpy)")
    made.set_defaults(perform=perform)


def perform(given: argparse.Namespace) -> int:
    """The campaign; 4 if a law broke without a note. Raises InputError for bad input."""
    if not 0 < given.minutes < math.inf:
        raise InputError(f"--minutes = {given.minutes} is not possible; give a positive number.")
    tally = campaign(given.law, given.effect or [None], 60 * given.minutes, given.seed, given.backend)
    print(table(tally))
    for reason, count in tally.refusals.most_common(12):
        print(f"refused {count}: {reason}")
    for where, scene in tally.breaks.items():
        print(f"\n== {where}\n{scene}")
    return 4 if tally.breaks else 0
