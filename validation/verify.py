"""Whether the published numbers still come out: `python -m validation verify`.

`verify.toml` names claims, measured anew at their published sizes, and values of single runs with a spread beside each.
They take seconds, and every system has some of them; `--draw` takes other claims, drawn at random. A claim deviates if
its verdict is another one, or if its median is outside of the published spread; a value, if it is outside of its
spread. Numbers are published with four digits, so that the ends of a spread are widened by `DIGITS`. Nothing stored is
reused.
"""

from __future__ import annotations

import json
import random
import statistics
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from refsim.core.errors import InputError
from validation import claims as claiming
from validation.checks import VERDICT, number
from validation.experiment import Experiment, Options, Part, Run, chosen, discover
from validation.perform import perform
from validation.results import finite
from validation.tables import Table

CHOSEN = Path(__file__).with_name("verify.toml")
LONGEST = 120.0  # [s] that a drawn claim may take
DIGITS = 1e-3  # relative; twice the rounding of a number with four digits
WANTED = {"experiment", "run", "quantity", "what", "unit", "measured", "spread", "varied"}


@dataclass(frozen=True)
class Value:
    """A quantity of a single run at a published size, as it stands in `verify.toml`.

    experiment, run, quantity   where it comes from: `values[quantity]` of the run of that key
    measured, spread            what is published, and the least and the largest that were found
    varied                      what differed between those
    """

    name: str
    experiment: str
    run: str
    quantity: str
    what: str
    unit: str
    measured: float
    spread: tuple[float, float]
    varied: str


@dataclass(frozen=True)
class Selection:
    """What is verified.

    claims    names; rounding: those whose number is a sum of rounding errors, which differs between machines, so that
              only the verdict is compared
    values    by name
    """

    claims: tuple[str, ...]
    rounding: frozenset[str]
    values: Mapping[str, Value]

    @property
    def names(self) -> tuple[str, ...]:
        """Claims and values."""
        return (*self.claims, *self.values)


@dataclass(frozen=True)
class Verified:
    """A published number and the one that came out now.

    why     what deviates, in a sentence; "" if nothing does
    """

    name: str
    what: str
    unit: str
    published: str
    now: tuple[float, ...]
    why: str


def read(path: Path | None = None) -> Selection:
    """What `verify.toml` names. Raises ValueError for an entry that does not say what it must."""
    entries = tomllib.loads((path or CHOSEN).read_text())
    if set(entries) != {"claims", "rounding", "value"} or not set(entries["rounding"]) <= set(entries["claims"]):
        raise ValueError(f"{path or CHOSEN} needs claims, rounding (some of the claims) and value; it has {[*entries]}")
    values = {}
    for name, entry in entries["value"].items():
        if set(entry) != WANTED or not entry["spread"][0] <= entry["measured"] <= entry["spread"][1]:
            raise ValueError(f"[value.{name}] needs {', '.join(sorted(WANTED))}, and measured within spread")
        values[name] = Value(name=name, **{**entry, "spread": tuple(entry["spread"])})
    return Selection(tuple(entries["claims"]), frozenset(entries["rounding"]), values)


def drawn(count: int, seed: int, longest: float = LONGEST) -> Selection:
    """Claims drawn at random from those whose runs are not timed and take at most `longest` seconds each claim.

    Raises InputError for a count below 1.
    """
    if count < 1:
        raise InputError(f"verify: --draw {count} is not possible; give 1 or more claims.")
    fixed, known, some = read(), discover(), []
    for name, claim in claiming.read_claims().items():
        how = known[claim.experiment].claims.get(name)
        if how is None or how.timed or not claim.starts or name in fixed.claims:
            continue
        runs = how.runs(Options())
        if not any(run.skip or run.alone for run in runs) and sum(run.estimate for run in runs) <= longest:
            some.append(name)
    return Selection(tuple(sorted(random.Random(seed).sample(some, min(count, len(some))))), frozenset(), {})


def verify(
    names: Sequence[str] = (), jobs: int = 1, threads: int | None = None, selection: Selection | None = None,
    known: Mapping[str, Experiment] | None = None, published: Mapping[str, claiming.Claim] | None = None,
) -> list[Verified]:  # fmt: skip
    """Compute the named numbers, all without names, in `jobs` processes, and compare them with the published ones.

    Raises InputError for a name that is not verified.
    """
    selection, known = selection or read(), known or discover()
    published = claiming.read_claims() if published is None else published
    some = list(dict.fromkeys(chosen(names, {name: name for name in selection.names}, "verified number")))
    made: list[Part] = []
    for name in some:
        if name in selection.values:
            value = selection.values[name]
            experiment, runs = value.experiment, _run_of(known[value.experiment], value.run)
        else:
            experiment = published[name].experiment
            runs = list(known[experiment].claims[name].runs(Options()))
        made.append(Part(VERDICT, name, experiment, runs, lambda results: ()))
    with tempfile.TemporaryDirectory() as folder:
        options = Options(fresh=True, threads=threads, results=Path(folder) / "results", figures=Path(folder) / "none")
        performed = perform(made, options, jobs)
    found = []
    for name, each in zip(some, performed):
        lost = [*each.stopped.values(), *each.skipped.values()]
        if name in selection.values:
            value = selection.values[name]
            now = [] if lost else [float(each.results[value.run].values[value.quantity])]
            found.append(_value(value, now, lost))
        else:
            how = known[published[name].experiment].claims[name]
            now = [] if lost else [float(x) for x in how.values(each.results)]
            found.append(_claim(published[name], now, lost, name in selection.rounding))
    return found


def _run_of(experiment: Experiment, key: str) -> list[Run]:
    return [run for run in experiment.runs(Options()) if run.key == key]


def within(value: float, spread: Sequence[float]) -> bool:
    """Whether a number is inside of a spread that was published with four digits; NaN is not."""
    low, high = spread
    return low - DIGITS * abs(low) <= value <= high + DIGITS * abs(high)


def _value(value: Value, now: Sequence[float], lost: Sequence[str]) -> Verified:
    said = _published(value.measured, value.spread, value.unit)
    why = ""
    if lost:
        why = f"{value.name}: {lost[0]}"
    elif not within(now[0], value.spread):
        why = (
            f"{value.name}: {value.what} is {number(now[0])}, published is {said}; find what changed it, and if that is"
            " meant, measure the spread again and write it into validation/verify.toml."
        )
    return Verified(value.name, value.what, value.unit, said, tuple(now), why)


def _claim(claim: claiming.Claim, now: Sequence[float], lost: Sequence[str], rounding: bool) -> Verified:
    said = f"{claim.verdict}, {_published(claim.measured, claim.spread, claim.unit)}"
    why, again = (
        "",
        f"find what changed it, and if that is meant, run `python -m validation claims {claim.name} --write`.",
    )
    if lost:
        why = f"{claim.name}: {lost[0]}"
    elif claim.judge(now) != claim.verdict:
        why = (
            f"{claim.name}: the verdict is {claim.judge(now)} ({claiming.spread_words(now)}), published is {said};"
            f" {again}"
        )
    elif not rounding and not within(statistics.median(now), claim.spread):
        why = f"{claim.name}: {claim.what} is {claiming.spread_words(now)}, published is {said}; {again}"
    return Verified(claim.name, claim.what, claim.unit, said, tuple(now), why)


def _published(measured: float, spread: Sequence[float], unit: str) -> str:
    low, high = spread
    ends = "" if low == high else f" ({number(low)} to {number(high)})"
    return f"{number(measured)}{'' if unit == '-' else f' {unit}'}{ends}"


def table(found: Sequence[Verified]) -> Table:
    """Published and present numbers side by side."""
    rows = [
        [f.name, f.published, claiming.spread_words(f.now) if f.now else "-", "deviates" if f.why else "holds"]
        for f in found
    ]
    return Table("Published numbers, computed anew", ["number", "published", "now", "state"], rows)


def as_json(found: Sequence[Verified]) -> str:
    """One object: every number by name."""
    named = {
        f.name: {"what": f.what, "unit": f.unit, "published": f.published, "now": f.now, "why": f.why} for f in found
    }
    return json.dumps(finite(named), indent=1, allow_nan=False)


def deviating(found: Sequence[Verified]) -> list[str]:
    """The sentences on what deviates."""
    return [f.why for f in found if f.why]
