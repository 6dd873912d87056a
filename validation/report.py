"""Reports on experiments that were performed: all tables as text, a short summary, and one page with everything.

The page is one HTML file that needs no other: pictures are embedded, links stay inside of it.
"""

from __future__ import annotations

import base64
import dataclasses
import datetime
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, TextIO

from refsim.core.tables import table
from validation.checks import CLAIM, FAIL, PASS, SHOWN, Check, Entry, in_range, number
from validation.perform import Performed
from validation.tables import Table

WIDTH, LINES = 100, 25  # characters of a line and lines of the summary, at most
FIVE = (  # the summary shows the first five that were measured: (experiment, how the check's name begins, in words)
    ("models", "rest_seconds.cut_jiang_zhu", "cube to rest, seconds of this machine"),
    ("dam_break", "f1_gain.detection_2d", "detection: F1, two-step above number density"),
    ("dam_break", "recall_gap.detection_2d", "detection: recall, two-step less fan scan"),
    ("dam_break", "detection_ratio.", "detection: time, two-step over fan scan"),
    ("droplet", "sphericity.cube_4913", "cube to sphere: sphericity at the end"),
    ("droplet", "kinetic_share.cube_4913", "cube to sphere: kinetic energy, end over peak"),
)
MIME = {".png": "image/png", ".webp": "image/webp"}


def report(performed: Sequence[Performed], stream: TextIO) -> None:
    """Write all tables; the checks come last."""
    for each in performed:
        for own in each.tables:
            print(f"\n{own}", file=stream)
    lines = notes(performed)
    if now := [r.about for each in performed for key, r in each.results.items() if key not in each.reused]:
        lines.append(f"Computing took {sum(about.get('seconds', 0.0) for about in now):.1f} s.")
    if lines:
        print("\n" + "\n".join(lines), file=stream)
    if checked := check_table(performed):
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


def check_table(performed: Sequence[Performed]) -> str:
    """All checks; the experiment is named once. "" without any."""
    rows, last = list[list[str]](), ""
    for each in performed:
        for c in each.checks:
            name = each.part.folder if each.part.kind == CLAIM else each.part.name
            rows.append([name if name != last else "", *_cells(c)])
            last = name
    head = ("experiment", "quantity", "paper, on file", "measured", "", "bar", "verdict")
    return table(rows, head, right=[3]) if rows else ""


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

    def five(self) -> list[tuple[str, str, Check]]:
        """(experiment, words, check) of the summary's five numbers; of several sizes the largest, which is the last."""
        found = []
        for experiment, begin, words in FIVE:
            named = [c for name, c in self.checks if name == experiment and c.name.startswith(begin)]
            exact = [c for c in named if c.name == begin]
            found += [(experiment, words, c) for c in exact[:1] or named[-1:]]
        return found[:5]


def summary(whole: Whole, page: Path) -> str:
    """The end of the main job, at most LINES lines of WIDTH characters: seconds, five numbers, what failed, places."""
    lines = []
    rows = [["", "measured", "paper", "bar", "verdict"]]
    rows += [[words, number(c.value), c.paper, c.bar, c.verdict] for _, words, c in whole.five()]
    lines += ["", *_plain(Table("", rows[0], rows[1:]))] if len(rows) > 1 else []
    count = {verdict: sum(c.verdict == verdict for _, c in whole.checks) for verdict in (PASS, FAIL, SHOWN)}
    said = f"{count[PASS]} checks passed, {count[FAIL]} failed, {count[SHOWN]} are shown without a bar."
    measured = [check for _, check in whole.claims if check is not None]
    changed = [check for check in measured if check.verdict == FAIL]
    if measured:
        said += f" Claims measured: {len(measured)}, {len(changed)} with a verdict other than written."
    last = [
        said, f"It took {whole.seconds:.0f} s.", f"Pictures: {whole.figures}",
        f"Every table, picture and verdict: {page}",
    ]  # fmt: skip
    bad = [f"failed: {name} {c.name}: {number(c.value)}, bar {c.bar}" for name, c in whole.checks if c.verdict == FAIL]
    bad += [f"stopped: {each.part.name} {key}: {why}" for each in whole.performed for key, why in each.stopped.items()]
    bad += [f"claim {c.name}: written {c.paper.partition(':')[0]}, now {c.found}" for c in changed]
    free = LINES - len(lines) - len(last) - 2
    if len(bad) > free:
        bad = [*bad[: free - 1], f"... and {len(bad) - free + 1} more, see the report"]
    lines += ["", *bad] if bad else []
    return "\n".join(_cut(line) for line in [*lines, "", *last])


def _cut(line: str) -> str:
    """The line, shortened to WIDTH characters in the middle of it, so that a path keeps its end."""
    half = (WIDTH - 3) // 2
    return line if len(line) <= WIDTH else f"{line[: WIDTH - 3 - half]}...{line[-half:]}"


def _plain(table: Table) -> list[str]:
    """The table's heading and rows alone."""
    _, heading, _, *rows = str(dataclasses.replace(table, note="")).splitlines()
    return [heading, *rows]


# The page

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 0 auto; max-width: 72rem; padding: 1rem 1.5rem; color: #222; }
h1, h2, h3 { line-height: 1.2; } h2 { border-bottom: 1px solid #ccc; margin-top: 2.5rem; }
table { border-collapse: collapse; font-size: 13px; margin: 0.5rem 0 1rem; }
.wide { overflow-x: auto; } caption { text-align: left; font-weight: 600; padding: 0.3rem 0; }
th, td { border-bottom: 1px solid #ddd; padding: 0.15rem 0.7rem 0.15rem 0; text-align: left; vertical-align: top; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.pass { color: #00734f; } .fail { color: #fff; background: #b3261e; font-weight: 600; } .shown { color: #666; }
figure { margin: 1rem 0; } img { max-width: 100%; height: auto; } figcaption, .note { color: #555; font-size: 13px; }
nav a { margin-right: 0.9rem; }
"""


def write_page(whole: Whole, path: Path) -> Path:
    """Write the page; returns its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(page(whole), encoding="utf-8")
    return path


def page(whole: Whole) -> str:
    """Every verdict, table and picture as one HTML document that loads nothing from elsewhere."""
    failed = [(name, c) for name, c in whole.checks if c.verdict == FAIL]
    here = ", ".join(f"{name} {value}" for name, value in whole.machine.items())
    day = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    head = ["experiment", "quantity", "paper", "measured", "unit", "bar", "verdict"]
    parts = [
        f"<h1>{escape(whole.title)}</h1>",
        f"<p>{day}. {escape(here)}. It took {whole.seconds:.0f} s.</p>",
        "<nav>" + " ".join(_link(name, name) for name in _names(whole)) + "</nav>",
        '<h2 id="summary">The numbers that matter</h2>',
        _html(head, [[_link(name, name), *_verdict_cells(c)] for name, _, c in whole.five()]),
        f"<p>{len(whole.checks)} quantities: {_counted(c for _, c in whole.checks)}.</p>",
    ]
    if failed:
        parts += [
            '<h2 id="failed">What failed</h2>',
            _html(head, [[_link(name, name), *_verdict_cells(c)] for name, c in failed]),
        ]
    if said := notes(whole.performed):
        parts += ["<ul>", *(f"<li>{escape(line)}</li>" for line in said), "</ul>"]
    for each in whole.performed:
        parts += _section(each, whole.titles.get(each.part.name, ""), head[1:])
    parts += ['<h2 id="claims">Claims of the papers</h2>', _claims(whole.claims)]
    title = escape(whole.title)
    return (
        f'<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f'<link rel="icon" href="data:,">\n<style>{STYLE}</style>\n</head>\n<body>\n'
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def _names(whole: Whole) -> list[str]:
    return ["summary", *(each.part.name for each in whole.performed), "claims"]


def _link(name: str, words: str) -> str:
    return f'<a href="#{escape(name)}">{escape(words)}</a>'


def _counted(checks: Iterable[Check]) -> str:
    verdicts = [c.verdict for c in checks]
    return ", ".join(f"{verdicts.count(v)} {words}" for v, words in ((PASS, "pass"), (FAIL, "fail"), (SHOWN, "shown")))


def _section(each: Performed, title: str, head: Sequence[str]) -> list[str]:
    """One experiment or panel: its pictures, verdicts and tables."""
    name = each.part.name
    made = [f'<h2 id="{escape(name)}">{escape(name)}{escape(f": {title}" if title else "")}</h2>']
    for picture, path in each.drawn.items():
        data = base64.b64encode(path.read_bytes()).decode("ascii")
        source = f"data:{MIME[path.suffix]};base64,{data}"
        words = escape(picture.replace("_", " "))
        made.append(f'<figure><img alt="{words}" src="{source}"><figcaption>{words}</figcaption></figure>')
    if each.checks:
        made.append(_html(head, [_verdict_cells(c) for c in each.checks]))
    return made + [_table(table) for table in each.tables]


def _verdict_cells(check: Check) -> list[str]:
    *words, verdict = _cells(check)
    return [*map(escape, words), f'<span class="{escape(check.verdict)}">{escape(verdict)}</span>']


def _claims(claims: Sequence[tuple[Entry, Check | None]]) -> str:
    rows = []
    for entry, check in claims:
        now = check.measured() if check else "(not measured here)"
        verdict = entry.verdict if check is None or check.verdict == PASS else f"{entry.verdict}, now {check.found}"
        mark = f'<span class="{check.verdict if check else PASS}">{escape(verdict)}</span>'
        rest = [in_range(entry) if entry.starts else "", now, entry.what or entry.says, entry.bar(), entry.name]
        rows.append([escape(entry.system), escape(entry.title), mark, *map(escape, rest)])
    return _html(["system", "claim", "verdict", "written", "measured now", "quantity", "bar", "name"], rows)


def _table(table: Table) -> str:
    """A table with its title, and its note below."""
    cells = [["-" if c is None else c if isinstance(c, str) else number(c) for c in row] for row in table.rows]
    note = f'<p class="note">{escape(table.note)}</p>' if table.note else ""
    return _html(table.heading, [list(map(escape, row)) for row in cells], table.title) + note


def _html(heading: Sequence[str], rows: Sequence[Sequence[str]], title: str = "") -> str:
    """A table; cells are HTML, the heading and the title are plain. Columns of numbers stand to the right."""
    right = [bool(rows) and all(_is_number(row[k]) for row in rows) for k in range(len(heading))]
    mark = [' class="number"' if each else "" for each in right]
    lines = ["".join(f"<th{m}>{escape(word)}</th>" for m, word in zip(mark, heading))]
    lines += ["".join(f"<td{m}>{cell}</td>" for m, cell in zip(mark, row)) for row in rows]
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    return f'<div class="wide"><table>{caption}\n{body}\n</table></div>'


def _is_number(cell: str) -> bool:
    return cell[:1].isdigit() or cell[:1] in "+-" or cell == "none"
