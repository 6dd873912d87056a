"""Whether new code gives old numbers: `python -m validation unchanged OLD`.

OLD is a folder with earlier sources, a checkout say. A number that held there and is stale now may still be right:
an edit that changes no answer changes the digest, too. For each such number one of its runs is computed under both
sources, on this machine. Where every value and array has the same bits, the record is renewed and names the commit of
the comparison; date and machine of the measurement stay. Seconds are not compared: a time has to be measured again.
"""

from __future__ import annotations

import concurrent.futures
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from validation import claims, published, stability
from validation.experiment import Experiment, Options, Run
from validation.published import HOLDS, STALE, Item
from validation.tables import Table

LONG = 15.0  # s: of a number all of whose runs take longer, a run of the small sizes is compared
WORKER = Path(__file__).with_name("unchanged_worker.py")
SAME, OTHER = "same bits", "differs"


@dataclass(frozen=True)
class Compared:
    """A stale number, the run that was computed under both sources, and what came of it: SAME, OTHER or why neither."""

    item: Item
    run: Run
    outcome: str


def comparable(known: Mapping[str, Experiment], old: Mapping[str, Mapping[str, Any]]) -> dict[str, tuple[Item, Run]]:
    """Numbers that are stale now and held under the old sources, each with its run to compare; no times.

    old  what `python -m validation stale --json` says there
    """
    found = {}
    small = _small_runs(known)
    for standing in published.standings((), known):
        item = standing.item
        if standing.state != STALE or old.get(item.key, {}).get("state") != HOLDS:
            continue
        if any(run.alone or run.skip for run in item.runs):
            continue
        own = min(item.runs, key=lambda run: run.estimate)
        alike = [run for run in small if run.function is own.function and not run.skip and run.estimate < own.estimate]
        if own.estimate > LONG and alike:
            own = max(alike, key=lambda run: (_shared(run, own), -run.estimate))
        found[item.key] = item, own
    return found


def _small_runs(known: Mapping[str, Experiment]) -> list[Run]:
    options = Options(quick=True)
    runs = [
        run
        for experiment in known.values()
        for part in (experiment.part(options), stability.part_of(experiment, options))
        for run in part.runs
    ]
    for claim in claims.read_claims().values():
        how = known[claim.experiment].claims.get(claim.name)
        runs += [] if how is None else how.runs(options)
    return runs


def _shared(run: Run, other: Run) -> int:
    return sum(name in run.parameters and run.parameters[name] == value for name, value in other.parameters.items())


def compare(old: Path, known: Mapping[str, Experiment], jobs: int, longest: float = math.inf) -> list[Compared]:
    """Compute a run of each number under both sources, in `jobs` processes of one thread.

    longest  seconds that a run may take, by its estimate; numbers without such a run are left out

    Raises InputError for a folder that holds no sources, or whose `validation stale` fails.
    """
    if not (old / "validation" / "published.py").exists():
        raise InputError(f"{old} holds no sources of refsim and its validation; give a checkout of an earlier commit.")
    if old.resolve() == published.ROOT:
        raise InputError(f"{old} holds these sources; give a checkout of an earlier commit.")
    told = subprocess.run(
        [sys.executable, "-m", "validation", "stale", "--json"], cwd=old, env=_environment(old), capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    if told.returncode:
        raise InputError(f"{old}: `python -m validation stale --json` fails there: {told.stderr.strip()[-300:]}")
    chosen = {key: (item, run) for key, (item, run) in comparable(known, json.loads(told.stdout)).items()
              if run.estimate <= longest}  # fmt: skip
    runs = {_name(run): run for _, run in chosen.values()}
    before = values(old, runs, jobs)
    after = values(published.ROOT, runs, jobs)
    unequal = {name: runs[name] for name in runs if before[name] != after[name] and _both(before[name], after[name])}
    again = values(published.ROOT, unequal, jobs)
    return [
        Compared(item, run, _outcome(before[_name(run)], after[_name(run)], again.get(_name(run))))
        for item, run in chosen.values()
    ]


Leaves = Mapping[str, str]


def _both(*found: Leaves | str) -> bool:
    return not any(isinstance(each, str) for each in found)


def _outcome(before: Leaves | str, after: Leaves | str, again: Leaves | str | None) -> str:
    """SAME where all values agree but those that the same sources do not repeat, such as seconds."""
    for found, where in ((before, "old"), (after, "new"), (again, "new")):
        if isinstance(found, str):
            return f"fails under the {where} sources: {found}"
    assert not isinstance(before, str)
    assert not isinstance(after, str)
    if again is None:
        return SAME
    assert not isinstance(again, str)
    repeated = {path: value for path, value in after.items() if again.get(path) == value}
    if not repeated:
        return "no value repeats"
    unequal = [path for path in repeated if before.get(path) != repeated[path]]
    return f"{OTHER}: {', '.join(sorted(unequal)[:3])}" if unequal or before.keys() != after.keys() else SAME


def _name(run: Run) -> str:
    parameters = json.dumps(run.parameters, sort_keys=True)
    return f"{run.function.__module__} {run.function.__qualname__} {parameters}"


def _environment(sources: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(sources.resolve()), "NUMBA_NUM_THREADS": "1"}


def values(sources: Path, runs: Mapping[str, Run], jobs: int) -> dict[str, Leaves | str]:
    """What each run gives under `sources`: digests of its values and arrays by their place, or why it gave none."""
    order = sorted(runs, key=lambda name: -runs[name].estimate)
    parts = [order[k::jobs] for k in range(jobs) if order[k::jobs]]
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(jobs) as pool:

        def part(number: int) -> dict[str, Leaves | str]:
            given, answer = Path(folder, f"{number}.json"), Path(folder, f"{number}.out")
            names = parts[number]
            given.write_text(
                json.dumps(
                    [
                        [
                            name,
                            runs[name].function.__module__,
                            runs[name].function.__name__,
                            dict(runs[name].parameters),
                        ]
                        for name in names
                    ]
                )
            )
            subprocess.run(
                [sys.executable, str(WORKER), str(given), str(answer)], cwd=sources, env=_environment(sources),
                check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
            )  # fmt: skip
            lines = answer.read_text().splitlines() if answer.exists() else []
            found = dict(json.loads(line) for line in lines)
            return {name: found.get(name, "its process ended") for name in names}

        return {name: found for each in pool.map(part, range(len(parts))) for name, found in each.items()}


def renew(found: Sequence[Compared], commit: str | None, path: Path | None = None) -> int:
    """Write today's digest, and the commit of the comparison, into the records with the same bits; returns how many."""
    records = published.read_records(path)
    same = [each.item for each in found if each.outcome == SAME]
    for item in same:
        records[item.key] = {**records[item.key], "digest": item.digest(), "same_bits_at": commit}
    published.write_records(records, path)
    return len(same)


def table(found: Sequence[Compared]) -> Table:
    """What was compared, differences first."""
    rows = [[each.item.kind, each.item.name, each.run.key, each.outcome] for each in found]
    same = sum(each.outcome == SAME for each in found)
    rows.sort(key=lambda row: (row[3] == SAME, row[:2]))
    return Table(f"{same} of {len(found)} stale numbers have the same bits", ["kind", "name", "run", "outcome"], rows)
