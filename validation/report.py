"""The report on experiments that were performed: tables, what was left out or reused, and all checks at the end."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TextIO

from validation.checks import number
from validation.perform import Performed
from validation.tables import aligned


def report(performed: Sequence[Performed], stream: TextIO) -> None:
    """Write all tables; the checks come last."""
    for each in performed:
        for table in each.tables:
            print(f"\n{table}", file=stream)
    notes: list[str] = []
    now = [r.about for each in performed for key, r in each.results.items() if key not in each.reused]
    for each in performed:
        name = each.part.name
        for why in dict.fromkeys(each.skipped.values()):
            keys = [key for key, reason in each.skipped.items() if reason == why]
            notes.append(f"{name}: left out {', '.join(keys)} ({why})")
        notes += [f"{name}: {key} stopped. {why}" for key, why in each.stopped.items()]
        if each.reused:
            dates = sorted({str(each.results[key].about.get("date")) for key in each.reused if key in each.results})
            notes.append(
                f"{name}: reused {', '.join(each.reused)}, computed on {' and '.join(dates)} (--fresh computes anew)"
            )
    if now:
        seconds, compiling = (sum(about.get(name, 0.0) for about in now) for name in ("seconds", "seconds_compiling"))
        notes.append(
            f"Computing took {seconds:.1f} s; of these, {compiling:.1f} s went into starting, and compiling or loading"
            " kernels."
        )
    if notes:
        print("\n" + "\n".join(notes), file=stream)
    if lines := check_table(performed):
        print("\n" + lines, file=stream)


def check_table(performed: Sequence[Performed]) -> str:
    """All checks; the experiment is named once. "" without any."""
    rows, last = [["experiment", "quantity", "paper", "measured", "", "bar", "verdict"]], ""
    for each in performed:
        for c in each.checks:
            name = each.part.name if each.part.name != last else ""
            rows.append([name, c.what, c.paper, number(c.value), c.unit, c.bar, c.verdict])
            last = each.part.name
    return "\n".join(aligned(rows, [False, False, False, True, False, False, False])) if len(rows) > 1 else ""


def as_json(performed: Sequence[Performed]) -> str:
    """One object: every check by name, with the experiment in front where several were performed."""
    several = len(performed) > 1
    named = {(f"{each.part.name}." if several else "") + c.name: c.plain() for each in performed for c in each.checks}
    return json.dumps(named, indent=1, allow_nan=False)
