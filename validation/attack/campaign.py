"""`python -m validation attack`: attacks refsim for some minutes and counts how it ends. Exit code 4 for findings."""

from __future__ import annotations

import argparse
import datetime
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from refsim.core.tables import table
from refsim.core.versions import versions
from validation import reading
from validation.attack import BAD, GOOD, KINDS
from validation.attack.pool import Ended, carry_out, perform

FINDINGS = Path(__file__).parent / "findings"
LEFT_OVER = 20.0  # s of the given time that the end of the processes and the report may take


def add_options(made: argparse.ArgumentParser) -> None:
    """The command line."""
    made.add_argument("--minutes", type=float, default=8.0, help="end after so long, done or not (8)")
    made.add_argument("--seed", type=int, default=1, help="the same seed draws the same trials (1)")
    made.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes; all cores by default")
    made.add_argument("--only", nargs="+", choices=tuple(KINDS), default=list(KINDS), help="kinds of trials")
    made.add_argument("--scale", type=float, default=1.0, help="share of the trials of a whole campaign (1)")
    made.add_argument("--out", type=Path, default=Path("results/attack"), help="folder for attack.json and findings")
    made.add_argument("--replay", type=Path, nargs="+", metavar="FILE", help="carry stored findings out again instead")
    made.set_defaults(perform=main)


def mixed(only: Sequence[str], scale: float) -> Iterator[tuple[str, int]]:
    """(kind, number) of all trials, the kinds spread evenly, so that an early end leaves a share of each."""
    counts = {kind: max(1, round(KINDS[kind][0] * scale)) for kind in only}
    order = sorted(((n + 0.5) / count, kind, n) for kind, count in counts.items() for n in range(count))
    return ((kind, n) for _, kind, n in order)


def commit() -> str:
    """The commit of this checkout, with "+" if files were changed; "unknown" outside of one."""
    name, changed = reading.commit(), reading.told("git", "-C", str(FINDINGS), "status", "--porcelain", "-uno")
    return "unknown" if name is None else f"{name}{'+' * bool(changed)}"


def store(found: Ended, seed: int, folder: Path, date: str) -> Path:
    """Write a finding to a file that `--replay` and tests/validation/test_attack.py read."""
    path = folder / f"{found.kind}_{seed}_{found.number}.json"
    folder.mkdir(parents=True, exist_ok=True)
    data = {"kind": found.kind, "seed": seed, "number": found.number, "date": date, "commit": commit()}
    data |= {"outcome": found.outcome, "words": found.words, "trial": found.trial}
    path.write_text(json.dumps(data, indent=1) + "\n")
    return path


def main(given: argparse.Namespace) -> int:
    """Run the campaign; 0 without findings, 4 with. Raises InputError for bad input."""
    for name in ("minutes", "jobs", "scale"):
        if not 0 < getattr(given, name) < 1e6:
            raise InputError(f"--{name} = {getattr(given, name)} is not possible; give a positive number.")
    return replay(given.replay) if given.replay else campaign(given)


def replay(files: Sequence[Path]) -> int:
    """Carry findings out again, in this process."""
    bad = 0
    for path in files:
        try:
            finding = json.loads(path.read_text())
            kind, trial = finding["kind"], finding["trial"]
        except (OSError, ValueError, KeyError) as error:
            raise InputError(f"{path} is no stored finding ({error}); give a file that --out holds.") from None
        outcome, words = carry_out(kind, trial)
        bad += outcome not in GOOD
        print(f"{path}: {outcome}: {words}")
    return 4 if bad else 0


def campaign(given: argparse.Namespace) -> int:
    """All trials, the table, and the JSON file."""
    date, began = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"), time.monotonic()
    counts: dict[str, Counter[str]] = {kind: Counter() for kind in given.only}
    findings: list[dict[str, Any]] = []
    stopped = False
    until = began + max(60 * given.minutes - LEFT_OVER, 1.0)
    try:
        for found in perform(mixed(given.only, given.scale), given.seed, given.jobs, until):
            counts[found.kind] += Counter({"trials": 1, found.outcome: 1})
            if found.outcome not in GOOD:
                path = store(found, given.seed, given.out / "findings", date)
                findings.append({"file": path.name, "outcome": found.outcome, "words": found.words})
                print(f"finding {path}: {found.outcome}: {found.words.splitlines()[-1:]}", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        stopped = True
    data: dict[str, Any] = {
        "date": date, "commit": commit(), "seed": given.seed, "jobs": given.jobs, "scale": given.scale,
        "interrupted": stopped, "seconds": round(time.monotonic() - began, 1), "versions": versions(),
        "counts": counts, "findings": findings,
    }  # fmt: skip
    if "disk" in given.only:
        from validation.attack.disk import method

        data["disk_method"] = method()
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "attack.json").write_text(json.dumps(data, indent=1) + "\n")
    names = [name for name in ("trials", *GOOD, *BAD) if any(counted[name] for counted in counts.values())]
    rows = [[kind, *(str(counted[name]) for name in names)] for kind, counted in counts.items()]
    print(table(rows, ("kind", *names), right=range(1, len(names) + 1)))
    print(f"{len(findings)} findings in {data['seconds']:.0f} s; {given.out / 'attack.json'}")
    return 4 if findings else 0
