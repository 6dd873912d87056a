"""Reports on experiments that were performed: all tables as text, a short summary, and one page with everything.

The page is a Markdown file; its pictures are the files of the folder of figures.
"""

import dataclasses
import datetime
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

from refsim.core.tables import columns, fitted, table
from refsim.core.writing import write_file
from validation.checks import CLAIM, FAIL, MISSED, PASS, SHOWN, Check, Entry, in_range, number
from validation.perform import Performed

WIDTH, LINES = 100, 25  # characters of a line and lines of the summary, at most
FIRST = (  # numbers of the summary, the first that were measured: (experiment, how the check's name begins, in words)
    ("models", "rest_seconds.cut_jiang_zhu", "cube to rest, seconds of this machine"),
    ("dam_break", "f1_gain.detection_2d", "detection: F1, refsim's two-step above number density"),
    ("dam_break", "f1_gain_paper", "detection: F1, the paper's two-step above number density"),
    ("dam_break", "recall_gap.detection_2d", "detection: recall, refsim's two-step less its fan scan"),
    ("dam_break", "recall_gap_paper.detection_2d", "detection: recall, the paper's two-step less its fan scan"),
    ("dam_break", "detection_ratio.", "detection: time, two-step over fan scan"),
    ("droplet", "sphericity.cube_4913", "cube to sphere: sphericity at the end"),
    ("droplet", "kinetic_share.cube_4913", "cube to sphere: kinetic energy, end over peak"),
)
SHOWN_FIRST = 6  # numbers; the paper's own method stands beside refsim's


def report(performed: Sequence[Performed], stream: TextIO) -> None:
    """Write all tables; the checks come last."""
    for each in performed:
        for shown in each.tables:
            print(f"\n{shown.text(columns())}", file=stream)
    lines = notes(performed)
    if now := [r.about for each in performed for key, r in each.results.items() if key not in each.reused]:
        lines.append(f"Computing took {sum(about.get('seconds', 0.0) for about in now):.1f} s.")
    if lines:
        print("\n" + "\n".join(lines), file=stream)
    if checked := check_table(performed, columns()):
        print("\n" + checked, file=stream)


def notes(performed: Sequence[Performed]) -> list[str]:
    """What was left out, what stopped, and what was reused."""
    made: list[str] = []
    for each in performed:
        name = each.part.name
        for why in dict.fromkeys(each.skipped.values()):
            keys = [key for key, reason in each.skipped.items() if reason == why]
            made.append(f"{name}: left out {', '.join(keys)} ({why})")
        made += [f"{name}: {key} stopped. {why}" for key, why in each.stopped.items()]
        if each.reused and each.part.kind != CLAIM:
            dates = sorted({str(each.results[key].about.get("date")) for key in each.reused if key in each.results})
            made.append(
                f"{name}: reused {', '.join(each.reused)}, computed on {' and '.join(dates)} (--fresh computes anew)"
            )
    return made


def check_table(performed: Sequence[Performed], width: float = math.inf) -> str:
    """All checks; the experiment is named once. "" without any."""
    rows, last = list[list[str]](), ""
    for each in performed:
        for c in each.checks:
            name = each.part.folder if each.part.kind == CLAIM else each.part.name
            rows.append([name if name != last else "", *_cells(c)])
            last = name
    head = ("experiment", "quantity", "paper, on file", "measured", "", "bar", "verdict")
    return table(rows, head, [3], width) if rows else ""


def _cells(check: Check) -> list[str]:
    what = f"{check.what} ({check.name})" if check.kind == CLAIM else check.what
    return [what, check.paper, check.measured(), check.unit, check.bar, check.said()]


def as_json(performed: Sequence[Performed]) -> str:
    """One object: every check by name, with the experiment in front where several were performed."""
    several = len(performed) > 1
    named = {(f"{each.part.name}." if several else "") + c.name: c.plain() for each in performed for c in each.checks}
    return json.dumps(named, indent=1, allow_nan=False)


@dataclass(frozen=True)
class Whole:
    """All that `scripts/reproduce.py` has done.

    titles   of the experiments, by name
    seconds  of wall time, of everything
    figures  folder of the pictures
    """

    title: str
    performed: Sequence[Performed]
    titles: Mapping[str, str]
    claims: Sequence[tuple[Entry, Check | None]]
    seconds: float
    machine: Mapping[str, Any]
    figures: Path

    @property
    def checks(self) -> list[tuple[str, Check]]:
        """(experiment, check) of every check."""
        return [(each.part.name, check) for each in self.performed for check in each.checks]

    def numbers(self) -> list[tuple[str, str, Check]]:
        """(experiment, words, check) of the summary's numbers; of several sizes the largest, which is the last."""
        rows = []
        for experiment, begin, title in FIRST:
            named = [c for name, c in self.checks if name == experiment and c.name.startswith(begin)]
            exact = [c for c in named if c.name == begin]
            rows += [(experiment, title, c) for c in exact[:1] or named[-1:]]
        return rows[:SHOWN_FIRST]


def summary(whole: Whole, page: Path) -> str:
    """The end of the main job: seconds, numbers, what failed, places. At most LINES lines where WIDTH fits.

    Lines are at most as wide as the terminal and WIDTH characters; longer ones are wrapped between words.
    """
    lines, width = [], min(columns(), WIDTH)
    rows = [["", "measured", "paper", "bar", "verdict"]]
    rows += [[title, number(c.value), c.paper, c.bar, c.verdict] for _, title, c in whole.numbers()]
    lines += ["", *table(rows[1:], rows[0], (1,), width).splitlines()] if len(rows) > 1 else []
    count = {verdict: sum(c.verdict == verdict for _, c in whole.checks) for verdict in (PASS, FAIL, SHOWN, MISSED)}
    said = [f"{count[PASS]} checks passed, {count[FAIL]} failed, {count[SHOWN]} are shown without a bar."]
    if count[MISSED]:
        said.append(f"{count[MISSED]} of the papers' own choices miss their bars, as on file.")
    measured = [check for _, check in whole.claims if check is not None]
    changed = [check for check in measured if check.verdict == FAIL]
    if measured:
        said.append(f"Claims measured: {len(measured)}, {len(changed)} with a verdict other than written.")
    last = [
        *said, f"It took {whole.seconds:.0f} s.", f"Pictures: {whole.figures}",
        f"Every table, picture and verdict: {page}",
    ]  # fmt: skip
    bad = [f"failed: {name} {c.name}: {number(c.value)}, bar {c.bar}" for name, c in whole.checks if c.verdict == FAIL]
    bad += [f"stopped: {each.part.name} {key}: {why}" for each in whole.performed for key, why in each.stopped.items()]
    bad += [f"claim {c.name}: written {c.paper.partition(';')[0]}, now {c.found}" for c in changed]
    last = fitted("\n".join(last), width).split("\n")
    lines += [""] if bad else []
    for k, each in enumerate(fitted(line, width).split("\n") for line in bad):
        if len(lines) + len(each) + len(last) + 2 > LINES:
            lines.append(f"... and {len(bad) - k} more, see the report")
            break
        lines += each
    return "\n".join([*lines, "", *last])


# The page


def write_page(whole: Whole, path: Path) -> Path:
    """Write the page; returns its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, page(whole, path))
    return path


def page(whole: Whole, path: Path) -> str:
    """Every verdict and table as Markdown, with the pictures by their places from the page's."""
    here = ", ".join(f"{name} {value}" for name, value in whole.machine.items())
    day = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    bad = [dataclasses.replace(e, checks=[c for c in e.checks if c.verdict == FAIL]) for e in whole.performed]
    parts = [f"# {whole.title}", f"{day}. {here}.", "## summary", _text(summary(whole, path))]
    parts += ["## failed", _text(check_table(bad) or "nothing"), "## notes", _text("\n".join(notes(whole.performed)))]
    for each in whole.performed:
        parts += [f"## {each.part.name}", whole.titles.get(each.part.name, "")]
        parts += [f"![{name}]({os.path.relpath(drawn, path.parent)})" for name, drawn in each.drawn.items()]
        parts += [_text(text) for text in (check_table([each]), *map(str, each.tables)) if text]
    return "\n\n".join([*parts, "## claims", _text(_claims(whole.claims))]) + "\n"


def _text(words: str) -> str:
    return f"```text\n{words}\n```"


def _claims(claims: Sequence[tuple[Entry, Check | None]]) -> str:
    rows = []
    for entry, check in claims:
        verdict = entry.verdict if check is None or check.verdict == PASS else f"{entry.verdict}, now {check.found}"
        now = check.measured() if check else "(not measured here)"
        rows.append([entry.system, entry.name, verdict, in_range(entry) if entry.starts else "", now, entry.bar()])
    return table(rows, ["system", "claim", "verdict", "written", "measured now", "bar"], width=math.inf)
