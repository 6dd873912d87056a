"""The one program that performs checks: `python -m validation check [NAME ...] [--kind KIND ...]`.

A name is that of an experiment, of a check, of a map, or of the source of claims. Every kind of check is a `Part`:
runs, whose results are stored, and what follows from them.
"""

import dataclasses
import random
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from validation import checks
from validation.checks import CLAIM, FAIL, HARD_CASE, REFUSED, STOPPED, VALUE, VERDICT, Check, Entry, number
from validation.experiment import Experiment, Options, Part, Results, RunSpec, chosen, discover
from validation.maps import cell_key, judged_cell, map_picture, map_table
from validation.perform import Performed, perform
from validation.results import real
from validation.tables import Table

LONGEST = 120.0  # [s] that a claim may take which is drawn at random


def parts(
    names: Sequence[str], kinds: Iterable[str], options: Options, known: Mapping[str, Experiment] | None = None
) -> list[Part]:
    """The parts with the named checks of these kinds, all without names. Raises InputError for an unknown name."""
    known = discover() if known is None else known
    kinds = list(kinds)
    owners: dict[str, set[str]] = {
        name: {""} for name, each in known.items() if VERDICT in kinds or contents(each, kinds)
    }
    for name, each in known.items():
        for own in contents(each, kinds):
            owners.setdefault(own, set()).add(name)
    entries = {entry.name: entry for entry in checks.read_all(CLAIM) if entry.experiment in known}
    systems = {entry.system for entry in entries.values()} if CLAIM in kinds else set()
    what = "experiment or check" if VERDICT in kinds else kinds[0]
    chosen([name for name in names if name not in systems], owners, what)
    wanted = []
    for name, experiment in known.items():
        whole = not names or name in names
        some = [own for own in names if name in owners.get(own, ())]
        if VERDICT in kinds and (whole or set(some) & set(checks.read(name, VERDICT))):
            wanted.append(experiment.part(options))
        if CLAIM in kinds:
            own = [e for e in entries.values() if e.experiment == name]
            wanted += [claim_part(e, experiment, options) for e in own if whole or e.name in some or e.system in names]
        tried = [own for own in some if own in checks.read(name, HARD_CASE) or own in {m.name for m in experiment.maps}]
        if HARD_CASE in kinds and (tried or whole) and contents(experiment, [HARD_CASE]):
            wanted.append(trial_part(experiment, options, () if whole else tried))
    return wanted


def contents(experiment: Experiment, kinds: Iterable[str]) -> dict[str, tuple[str, str]]:
    """(kind, words) of an experiment's checks of some kinds, and of its maps and panels, by name."""
    described = {}
    for kind in kinds:
        described |= {
            name: (kind, entry.title or entry.what) for name, entry in checks.read(experiment.name, kind).items()
        }
        if kind == HARD_CASE:
            described |= {m.name: (kind, m.title) for m in experiment.maps}
    return described


def claim_part(entry: Entry, experiment: Experiment, options: Options) -> Part:
    """A claim's runs, and the verdict once all of them are there."""
    how, skip = experiment.claims.get(entry.name), ""
    if how is None or not entry.rule:
        skip = entry.reason or "there is no measure"
    elif options.quick and not how.quick:
        skip = "takes the published sizes; run without --quick"
    if how is None or skip:
        return Part(CLAIM, entry.name, entry.experiment, [RunSpec(entry.name, _nothing, skip=skip)], lambda results: ())
    runs = [dataclasses.replace(run, timed=run.timed or how.timed) for run in how.runs(options)]

    def judged(results: Results) -> list[Check]:
        whole = all(run.key in results for run in runs)
        return [checks.checked(entry, [float(value) for value in how.values(results)])] if whole else []

    return Part(CLAIM, entry.name, entry.experiment, runs, judged)


def _nothing() -> Any:
    raise NotImplementedError


def trial_part(experiment: Experiment, options: Options, only: Sequence[str] = (), folder: Path | None = None) -> Part:
    """An experiment's hard cases and maps; `only` names some of them."""
    hard = [e for e in checks.read(experiment.name, HARD_CASE, folder).values() if not only or e.name in only]
    maps = [m for m in experiment.maps if not only or m.name in only]
    runs = []
    for entry in hard:
        skip = "long; run without --quick" if options.quick and not entry.short and not only else ""
        parameters = {**entry.given, "backend": options.backend}
        runs.append(RunSpec(entry.name, experiment.trials[entry.trial], parameters, estimate=entry.seconds, skip=skip))
    for m in maps:
        if options.quick and not only:
            runs.append(RunSpec(m.name, m.cells[0].function, skip="a sweep of many runs; run without --quick"))
            continue
        for cell in m.cells:
            parameters = {**cell.parameters, "backend": options.backend}
            runs.append(RunSpec(cell_key(m, cell), cell.function, parameters, estimate=cell.seconds))

    def judged(results: Results) -> list[Check]:
        judgements = []
        for entry in (e for e in hard if e.name in results):
            values = results[entry.name].values
            held, of = sum(check["held"] for check in values["checks"].values()), len(values["checks"])
            judgements.append(
                dataclasses.replace(checks.checked(entry, [held], values["outcome"]), unit=f"of {of} checks")
            )
        return [*judgements, *(judged_cell(m, c, results[cell_key(m, c)]) for m in maps for c in m.cells
                         if cell_key(m, c) in results)]  # fmt: skip

    def tables(results: Results) -> list[Table]:
        rows = [[e.name, e.what, results[e.name].values["outcome"], worst(results[e.name].values)]
                for e in hard if e.name in results]  # fmt: skip
        heading = ["case", "what is hard", "outcome", "nearest to its bound"]
        every = [Table(f"Hard cases: {experiment.name}", heading, rows), *(map_table(m, results) for m in maps)]
        return [table for table in every if table.rows]

    names = {entry.name for entry in hard}
    pictures = [*map(map_picture, maps), *(p for p in experiment.pictures if names & set(p.needs))]
    return Part(HARD_CASE, experiment.name, experiment.name, runs, judged, pictures, tables)


def worst(values: Mapping[str, Any]) -> str:
    """The check that is nearest to its bound, or beyond it, in words; the first sentence of a stop or a refusal."""
    if values["outcome"].startswith((STOPPED, REFUSED)):
        return values["message"].partition(": ")[0].partition(";")[0].rstrip(".")

    def used(check: Mapping[str, Any]) -> float:
        value, bound = real(check["value"]), real(check["bound"])
        if not check["held"]:
            return 2.0
        if check["rule"] == "exactly" or bound == 0:
            return 0.0
        share = value / bound if check["rule"] == "at most" else bound / value if value else 0.0
        return share if share == share else 2.0

    if not values["checks"]:
        return "-"
    what, check = max(values["checks"].items(), key=lambda item: used(item[1]))
    return f"{what} {number(real(check['value']))} ({check['rule']} {number(real(check['bound']))})"


# Published numbers, computed anew


def selected(names: Sequence[str] = ()) -> list[Entry]:
    """What `verify` computes: claims with `verify`, and values. Raises InputError for a name that is not among them."""
    known = {entry.name: entry for entry in checks.read_all() if entry.verify or entry.kind == VALUE}
    return chosen(dict.fromkeys(names), known, "verified number")


def drawn(count: int, seed: int) -> list[Entry]:
    """Claims drawn at random from those whose runs are not timed and take at most LONGEST seconds each claim.

    Raises InputError for a count below 1.
    """
    if count < 1:
        raise InputError(f"verify: --draw {count} is not possible; give 1 or more claims.")
    some = []
    for entry in checks.read_all(CLAIM):
        how = discover()[entry.experiment].claims.get(entry.name)
        if how is None or how.timed or not entry.starts or entry.verify:
            continue
        runs = how.runs(Options())
        if not any(run.skip or run.alone for run in runs) and sum(run.estimate for run in runs) <= LONGEST:
            some.append(dataclasses.replace(entry, verify="number"))
    return sorted(random.Random(seed).sample(some, min(count, len(some))), key=lambda entry: entry.name)


def verify(entries: Sequence[Entry], jobs: int, threads: int | None, known: Mapping[str, Experiment] | None = None
           ) -> list[tuple[Entry, Check | None, str]]:  # fmt: skip
    """Compute published numbers in `jobs` processes, and say of each why it deviates, or "".

    Nothing stored is reused. A claim deviates if its verdict is another one, or if its median is outside of the spread.
    """
    known = discover() if known is None else known
    with tempfile.TemporaryDirectory() as folder:
        options = Options(fresh=True, threads=threads, results=Path(folder) / "results", figures=Path(folder) / "none")
        wanted = [
            (value_part if entry.kind == VALUE else claim_part)(entry, known[entry.experiment], options)
            for entry in entries
        ]
        performed = perform(wanted, options, jobs)
    return [(entry, *_deviation(entry, each)) for entry, each in zip(entries, performed)]


def value_part(entry: Entry, experiment: Experiment, options: Options) -> Part:
    """A published quantity of a single run."""
    runs = [run for run in experiment.runs(options) if run.key == entry.run]

    def judged(results: Results) -> list[Check]:
        return [checks.checked(entry, [float(r.values[entry.quantity])]) for r in results.values()]

    return Part(VALUE, entry.name, entry.experiment, runs, judged)


def _deviation(entry: Entry, each: Performed) -> tuple[Check | None, str]:
    """What came out, and in one sentence how it deviates from what is published."""
    again = "find what changed it, and if that is meant, measure the spread again and write it into expected.toml."
    if entry.kind == CLAIM:
        again = f"find what changed it, and if that is meant, run `python -m validation claims {entry.name} --write`."
    if lost := [*each.stopped.values(), *each.skipped.values()]:
        return None, f"{entry.name}: {lost[0]}"
    (check,) = each.checks
    if entry.kind == CLAIM and check.verdict == FAIL:
        said = f"the verdict is {check.found} ({check.measured()}), published is {published(entry)}"
    elif entry.verify != "verdict" and not entry.within(check.value):
        said = f"{entry.what} is {check.measured()}, published is {published(entry)}"
    else:
        return check, ""
    return check, f"{entry.name}: {said}; {again}"


def published(entry: Entry) -> str:
    """What is on file, with its spread."""
    low, high = entry.spread
    ends = "" if low == high else f" ({number(low)} to {number(high)})"
    said = f"{number(entry.measured)}{'' if entry.unit == '-' else f' {entry.unit}'}{ends}"
    return f"{entry.verdict}, {said}" if entry.kind == CLAIM else said


def verified_table(verified: Sequence[tuple[Entry, Check | None, str]]) -> Table:
    """Published and present numbers side by side."""
    rows = [
        [entry.name, published(entry), check.measured() if check else "-", "deviates" if why else "holds"]
        for entry, check, why in verified
    ]
    return Table("Published numbers, computed anew", ["number", "published", "now", "state"], rows)


def claims_of(performed: Sequence[Performed]) -> list[tuple[Entry, Check | None]]:
    """The claims among what was performed, and what came out of those that were measured."""
    entries = {entry.name: entry for entry in checks.read_all(CLAIM)}
    claims = [each for each in performed if each.part.kind == CLAIM]
    return [(entries[each.part.name], each.checks[0] if each.checks else None) for each in claims]
