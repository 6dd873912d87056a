"""Campaigns: scenes drawn by Hypothesis, held to laws, in one table of laws by effects."""

import argparse
import contextlib
import math
import time
import traceback
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import hypothesis
import numba

from refsim import InputError, RunStopped, Scene, make_plan
from refsim.core.effect import EFFECTS
from refsim.core.writing import write_file
from refsim.scene.files import scene_to_toml
from validation.laws import exact  # noqa: F401  (its laws are then known)
from validation.laws.laws import LAWS, OWN, Found, other_backend, stops
from validation.laws.scenes import FEW, MANY, Drawn, drawn

OUTCOMES = ("held", "noted", "broken", "refused", "stopped")
TURN = 5  # scenes of a turn
# What a note must say to excuse a law that broke
EXCUSES = {"rest": ("does not stay at rest",), "addition": ("does not stay at rest",), "ledger": ("momentum", "energy")}
SAME = ("units", "frames", "same run")  # laws that vary a scene into one that is possible, too
REJECTED = 8  # scenes of a trial that are refused or to which the law does not apply
SMALLER = 30  # trials that make a scene smaller


class Broken(Exception):
    """A law that does not hold, without a note."""


class Enough(BaseException):
    """A scene was made smaller for long enough."""


class Tally(NamedTuple):
    """Outcomes by (law, effect) and by law, reasons of refusals and stops, and the smallest scene of each break."""

    table: dict[tuple[str, str], Counter[str]]
    laws: dict[str, Counter[str]]
    refusals: Counter[str]
    breaks: dict[str, str]


def campaign(
    laws: list[str], effects: list[str | None], seconds: float, seed: int, backend: str, until_first: bool = False
) -> Tally:
    """Turns over laws and effects until the processor time is over, or a law breaks; laws in OWN have one for all."""
    tally = Tally(defaultdict(Counter), defaultdict(Counter), Counter(), {})
    until, turn = time.process_time() + seconds, 0
    asked = [(n, each, e) for k, e in enumerate(effects) for n in laws for each in LAWS[n] if not (k and each in OWN)]
    asked = [each for each in asked if backend != "numpy" or each[1] is not other_backend]
    while turn == 0 or time.process_time() < until:
        for name, each, effect in asked:
            if (turn and time.process_time() > until) or (until_first and tally.breaks):
                return tally
            if not any(where.startswith(f"{name}/{each.__name__}") for where in tally.breaks):
                _turn(name, each, None if each in OWN else effect, seed + turn, backend, tally)
        turn += 1
    return tally


def _turn(name: str, law: Callable[..., Any], effect: str | None, seed: int, backend: str, tally: Tally) -> None:
    """One law on some scenes, each drawn by a seed of its own: Hypothesis would vary one; the simplest is left out."""
    compiled = backend != "numpy" and not numba.config.DISABLE_JIT  # many particles, and one combination a turn
    given = drawn(effect, *((MANY, seed) if compiled else (FEW,)))
    for k in range(TURN):
        broken: list[tuple[int, str]] = []
        _trial(name, law, given, 1000 * seed + k, backend, tally, broken)
        if broken:
            tally.breaks[f"{name}/{law.__name__}" + (f" ({effect})" if effect else "")] = min(broken)[1]
            return


def _trial(
    name: str, law: Callable[..., Any], given: Any, seed: int, backend: str, tally: Tally, broken: list[tuple[int, str]]
) -> None:
    """One scene to which the law applies; one that breaks it is made smaller SMALLER times at most."""
    tried = rejected = 0

    @hypothesis.settings(max_examples=1, deadline=None, database=None, suppress_health_check=[*hypothesis.HealthCheck])
    @hypothesis.seed(seed)
    @hypothesis.given(given)
    def trial(scene: Drawn) -> None:
        nonlocal tried, rejected
        first, tried = not tried, tried + (bool(broken) or not tried)
        if tried > SMALLER or rejected > REJECTED:
            raise Enough
        outcome, found = ("simplest", None) if first else judged(name, law, scene, backend, tally.refusals)
        if not broken and outcome in OUTCOMES:
            tally.laws[name][outcome] += 1
            acted = found.scene or (None if law in OWN else scene.scene)
            for acting in acted.effects if acted else ():
                tally.table[name, acting.name][outcome] += 1
        if outcome in ("simplest", "refused", "not applied"):
            rejected += 1
            hypothesis.reject()  # for another scene
        if outcome == "broken":
            words = f"{found.how}: found {found.value:.3g}, bound {found.bound:.3g}"
            size = sum(len(part.position) for part in scene.scene.fluid) + 100 * len(scene.scene.effects)
            broken.append((size, f"{words}\n{_written(scene, found.scene)}"))
            raise Broken

    with contextlib.suppress(Broken, Enough, hypothesis.errors.HypothesisException):  # no scene, say
        trial()


def _written(scene: Drawn, other: Scene | None) -> str:
    """The scene as TOML without what is usual, its particles as the cells and the seed that they were drawn from."""
    usual = set(scene_to_toml(Scene(spacing=1.0, support_radius=2.0, fluid=())).splitlines())
    lines = [line for line in scene_to_toml(other or scene.scene).splitlines() if line not in usual or not line]
    drawn_anew = ("position =", "velocity = [[")
    return "\n".join([f"# cells {scene.cells}, seed {scene.seed}", *(a for a in lines if not a.startswith(drawn_anew))])


def judged(name: str, law: Callable[..., Any], scene: Drawn, backend: str, refusals: Counter[str]) -> tuple[str, Found]:
    """(outcome, what was found) of a law in a scene."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = law(scene, backend)
            if found is None:
                return "not applied", Found(math.nan, math.nan)
            if found.value <= found.bound:
                return "held", found
            notes = make_plan(found.scene or scene.scene).notes
            said = any(word in note for note in notes for word in EXCUSES.get(name, ()))
            return ("noted" if said else "broken"), found
        except (InputError, RunStopped) as error:
            stopped = isinstance(error, RunStopped)
            refusals[f"stopped: {error.reason}" if stopped else str(error).split(";")[0][:120]] += 1
            possible = (name in SAME and law is not other_backend) or (stopped and name != "absence")
            steps = max(20, scene.steps) * stopped  # of the longest run of a law
            alone = name != "silence is truth" if law in OWN else possible and not stops(scene.scene, backend, steps)
            found = Found(math.nan, 0.0, f"as drawn it runs: {error}")
            return ("broken" if alone else "stopped" if stopped else "refused"), found
        except Exception:  # any other error is a finding
            return "broken", Found(math.nan, 0.0, traceback.format_exc(limit=-3))


def table(tally: Tally) -> str:
    """Outcomes, a line a law; then scenes that held, a line an effect, with ! and the number of those that did not."""
    laws = sorted(tally.laws)
    lines = [f"{'law':22}" + "".join(f"{word:>9}" for word in OUTCOMES)]
    lines += [f"{law:22}" + "".join(f"{tally.laws[law][word]:9}" for word in OUTCOMES) for law in laws]
    lines += ["", f"{'effect':24}" + "".join(f"{law.split()[0][:9]:>11}" for law in laws)]
    for effect in sorted({effect for _, effect in tally.table}):
        cells = [tally.table[law, effect] for law in laws]
        words = [f"{c['held']}" + (f"!{c['broken']}" if c["broken"] else "") if c else "" for c in cells]
        lines.append(f"{effect:24}" + "".join(f"{word:>11}" for word in words))
    return "\n".join(lines)


def add_options(made: argparse.ArgumentParser) -> None:
    """The command line."""
    made.add_argument("--minutes", type=float, default=10.0, help="processor minutes (10)")
    made.add_argument("--seed", type=int, default=1, help="of the first turn (1)")
    made.add_argument("--law", nargs="+", choices=sorted(LAWS), default=sorted(LAWS), help="all by default")
    made.add_argument("--effect", nargs="+", choices=sorted(EFFECTS), help="scenes with these effects alone")
    made.add_argument("--backend", default="numpy", help="numpy, cpu or cuda (numpy)")
    made.add_argument("--page", type=Path, help="a page that has the table, which is renewed")
    made.add_argument("--first", action="store_true", help="stop at the first break")
    made.set_defaults(perform=perform)


def perform(given: argparse.Namespace) -> int:
    """The campaign; 4 if a law broke without a note. Raises InputError for bad input."""
    if not 0 < given.minutes < math.inf:
        raise InputError(f"--minutes = {given.minutes} is not possible; give a positive number.")
    tally = campaign(given.law, given.effect or [None], 60 * given.minutes, given.seed, given.backend, given.first)
    print(found := table(tally))
    if given.page:
        head, mark, rest = given.page.read_text(encoding="utf-8").partition("```text\n")
        when = f"seed {given.seed}, {given.minutes:g} processor minutes on {given.backend}"
        write_file(given.page, f"{head}{mark}{when}\n\n{found}\n{rest[rest.index('```') :]}")
    for reason, count in tally.refusals.most_common(30):
        print(f"{count} refused: {reason}")
    for where, scene in tally.breaks.items():
        print(f"\n== {where}\n{scene}")
    return 4 if tally.breaks else 0
