"""What is published of checks: the numbers on file and on the pages, and the rows of docs/checks.md.

`python -m validation claims --write` renews the numbers on pages and the plain rows. The site puts rows that open in
their place (`docs/site_pages.py`), from the entries on file and what was stored beside figures.
"""

import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from refsim.core.writing import write_file
from validation import checks
from validation.checks import (
    CLAIM,
    HARD_CASE,
    REFUTED,
    VALUE,
    Check,
    Entry,
    Sentence,
    short,
)
from validation.drawing import read_origin
from validation.experiment import COMMANDS, Experiment, discover
from validation.filling import ROOT, filled_page, records, replaced, stored, with_reasons
from validation.perform import Performed
from validation.results import finite, origin

SYSTEMS = {  # of a paper's claims, and what the page calls their source; others are of this project
    "jiang_zhu_2023": "Jiang & Zhu 2023", "dong_2016": "Dong, Zhang & Chen 2016", "mpm": "thesis on MPM: transfers",
    "surface_energy": "thesis on MPM: surface", "heat": "Shao & Song 2017: heat",
    "melting": "Shao & Song 2017: melting", "one_way_coupling": "patent CN104318598A",
}  # fmt: skip


# Numbers on file and on the pages


def write(found: Sequence[tuple[Entry, Check | None]]) -> None:
    """Put what was measured of claims into the experiments' files, and renew the pages."""
    for entry, check in found:
        if check is not None:
            middle, low, high = map(_rounded, (check.value, min(check.values), max(check.values)))
            values = {"measured": middle, "spread": [low, high], "starts": len(check.values), "verdict": check.found}
            if null := discover()[entry.experiment].claims[entry.name].null():
                values["null"] = _rounded(checks.median(null))
            _rewrite(checks.FOLDER / entry.experiment / "expected.toml", entry.name, values)
    checks.forget()
    write_pages()


def _rewrite(path: Path, name: str, values: Mapping[str, Any]) -> None:
    text = path.read_text(encoding="utf-8")
    begin = re.search(rf"^\[check\.{re.escape(name)}\]$", text, re.MULTILINE).start()  # type: ignore[union-attr]
    stop = text.find("\n[", begin + 1)
    entry = text[begin : stop if stop > 0 else None]
    for key, value in values.items():
        entry, count = re.subn(rf"^{key} = .*$", f"{key} = {_toml(value)}", entry, flags=re.MULTILINE)
        if count != 1:
            raise ValueError(f"[check.{name}] has {count} lines {key} = ...")
    write_file(path, text[:begin] + entry + (text[stop:] if stop > 0 else ""))


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _toml(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value)


def write_pages() -> None:
    """Renew the numbers of all pages, and the rows of claims and checks."""
    for page in (ROOT / "docs").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        if (new := renewed(text)) != text:
            write_file(page, new)
    for path, text in paper_pages().items():
        write_file(path, text)
    write_file(CHECKS, checks_page())


def renewed(text: str) -> str:
    """A page with the numbers on file."""
    return filled_page(text, records(checks.read_all(CLAIM)))


CHECKS = ROOT / "docs" / "checks.md"
PAPERS = {  # page of each source
    "Jiang & Zhu 2023": "paper_jiang_zhu", "Dong, Zhang & Chen 2016": "paper_dong", "thesis on MPM": "paper_mpm_thesis",
    "Shao & Song 2017": "paper_shao_song", "patent CN104318598A": "paper_patent",
}  # fmt: skip


def paper_pages() -> dict[Path, str]:
    """The page of each source, with its sentences in its order and all claims that read them."""
    of: dict[str, dict[Sentence, list[Entry]]] = {source: {} for source in PAPERS}
    for entry in with_reasons(checks.read_all(CLAIM)):
        if said := entry.sentence:
            of[_source(said.system)].setdefault(said, []).append(entry)
    pages = {}
    for source, name in PAPERS.items():
        path, lines = ROOT / "docs" / f"{name}.md", ["| the source says | found |", "| --- | --- |"]
        for said in sorted(of[source], key=_place):
            cells = (f"{said.says} *{said.place}:* {said.words}", "<br>".join(map(finding, of[source][said])))
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        pages[path] = replaced(path.read_text(encoding="utf-8"), "claims", lines, path)
    return pages


def _source(system: str) -> str:
    return SYSTEMS[system].partition(":")[0]


def _place(said: Sentence) -> tuple[int, list[int]]:
    """Where a sentence stands: abstract and introduction come first."""
    parts = ("abstract", "introduction")
    return next((k for k, part in enumerate(parts) if said.place.startswith(part)), 2), [
        int(number) for number in re.findall(r"\d+", said.place.replace("claim", "9999"))
    ]


def finding(entry: Entry) -> str:
    """Name, verdict and effect of a claim."""
    said = f"{entry.what}: {checks.in_range(entry)}" if entry.starts else entry.reason
    verdict = f"**{REFUTED}**" if entry.verdict == REFUTED else entry.verdict
    return f"`{entry.name}` {verdict}. {sentence(said)}"


def sentence(text: str) -> str:
    """The words as a sentence."""
    return f"{text[0].upper()}{text[1:]}{'' if text.endswith('.') else '.'}"


def keep(performed: Sequence[Performed], folder: Path) -> None:
    """Write every value of the claims that were measured to `claims.json` among the figures."""
    path = folder / "claims.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    for each in performed:
        for check in each.checks if each.part.kind == CLAIM else ():
            kept[check.name] = finite(
                {"values": check.values, "unit": check.unit, "bar": check.bar, "verdict": check.found,
                 **origin(each.results.values())}
            )  # fmt: skip
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in kept.items()]
    write_file(path, "{\n" + ",\n".join(lines) + "\n}\n")


# The rows of docs/checks.md


ROWS = "<!-- checks -->"  # what stands below it is written by a program


def checks_page() -> str:
    """docs/checks.md: its words, and a row for every check but the claims, which have a page of their own."""
    head = CHECKS.read_text(encoding="utf-8").partition(ROWS)[0]
    lines = [head + ROWS]
    entries = sorted((e for e in with_reasons(checks.read_all()) if e.kind != CLAIM), key=lambda e: e.experiment)
    for experiment, group in itertools.groupby(entries, key=lambda e: e.experiment):
        lines += [f"\n## {experiment.replace('_', ' ').capitalize()}\n", "| check | verdict | measured | bar |"]
        lines.append("| --- | --- | --- | --- |")
        for entry in group:
            cells = f"`{entry.name}` {entry.title or entry.what}", verdict_of(entry), measured(entry), _bar(entry)
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def measured(entry: Entry) -> str:
    """How a check went, its value, and of how many starts."""
    how = entry.verdict.partition(": ")[2]
    if entry.starts:
        return f"{how}: {checks.in_range(entry)}, {entry.starts} {entry.over}".removeprefix(": ")
    return checks.in_range(entry) if entry.kind == VALUE else how


def _bar(entry: Entry) -> str:
    return entry.bar() or entry.paper


def table() -> Iterator[str]:
    """Every check as a row of one HTML table, with what opens below it; docs/_static/checks.js filters the rows."""
    entries, known, kept = with_reasons(checks.read_all()), discover(), stored()
    entries.sort(key=lambda entry: entry.kind == checks.VERDICT)  # those without a number on file stand last
    of = {entry.name: system_of(entry, known) for entry in entries}
    verdicts = dict.fromkeys(verdict_of(entry) for entry in entries)
    yield '<form id="filter">'
    yield _choice("system", sorted(set(of.values())))
    yield _choice("kind", [kind for kind in checks.KINDS if any(e.kind == kind for e in entries)])
    yield _choice("verdict", list(verdicts))
    yield _choice("backend", ["cpu", "cuda"])
    yield '<input name="words" type="search" placeholder="words" aria-label="words"> <output></output></form>'
    yield '<div class="wide"><table id="checks"><thead><tr>'
    yield "".join(f"<th>{head}</th>" for head in ("check", "verdict", "measured", "bar")) + "</tr></thead><tbody>"
    for entry in entries:
        yield _row(entry, known[entry.experiment], kept.get(entry.name, {}), of[entry.name])
    yield "</tbody></table></div>"


def system_of(entry: Entry, known: Mapping[str, Experiment]) -> str:
    """The paper whose claim it is, or what the experiment is about."""
    return SYSTEMS.get(entry.system, entry.system) if entry.system else entry.experiment.replace("_", " ")


def verdict_of(entry: Entry) -> str:
    """Verdict on file in one word; "bar" of what is judged at every run, "missed" where a bar is known to be missed,
    "shown" of what has no bar."""
    if entry.kind in (CLAIM, HARD_CASE):
        return entry.word
    return "published" if entry.kind == VALUE else "missed" if entry.misses else "bar" if entry.rule else "shown"


def _choice(name: str, values: Sequence[str]) -> str:
    options = "".join(f"<option>{escape(value)}</option>" for value in values)
    return f'<select name="{name}" aria-label="{name}"><option value="">every {name}</option>{options}</select>'


def _row(entry: Entry, experiment: Experiment, kept: Mapping[str, Any], system: str) -> str:
    """A row, and a second one with sources, readings, pictures and the command."""
    verdict, backend = verdict_of(entry), "cuda" if "gpu" in (kept.get("machine") or {}) else "cpu"
    data = f'data-system="{escape(system)}" data-kind="{entry.kind}" data-verdict="{verdict}" data-backend="{backend}"'
    cells = [escape(entry.title or entry.what), f'<b class="{verdict.replace(" ", "-")}">{verdict}</b>',
             escape(measured(entry)), escape(_bar(entry))]  # fmt: skip
    name = f"<br><code>{escape(entry.name)}</code>"
    opened = "".join(f"<dt>{head}</dt><dd>{text}</dd>" for head, text in _details(entry, experiment, kept) if text)
    return (
        f'<tr class="check" {data}><td><details><summary>{cells[0]}</summary>{name}<dl>{opened}</dl></details></td>'
        + "".join(f"<td>{cell}</td>" for cell in cells[1:])
        + "</tr>"
    )


def _details(entry: Entry, experiment: Experiment, kept: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """(heading, HTML) of what a row opens."""
    yield "quantity", escape(entry.what if entry.title else "")
    said = entry.sentence
    yield "source", escape(f"“{said.says}” ({said.words}; {said.place})" if said else entry.source)
    yield "given there", escape(said.parameters if said else "")
    yield "reading", escape(entry.reading)
    yield "remark", escape(sentence(entry.reason) if entry.reason else "")
    yield "one start is enough", escape(entry.fixed)
    how = experiment.claims.get(entry.name)
    if how is not None and how.family is not None:
        null = "" if math.isnan(entry.null) else f", which gives {short(entry.null)}"
        yield "how it could have failed", escape(f"{how.family.fails} Null model: {how.family.null}{null}.")
    runs = {entry.name} if entry.kind == HARD_CASE else set()
    shown = [p for p in experiment.pictures if runs & set(p.needs)] or experiment.pictures[: 0 if runs else 3]
    pictures = [p for p in shown if (ROOT / "figures" / p.file).exists()]
    links = (f'<a href="_images/{p.file}">{escape(p.name.replace("_", " "))}</a>' for p in pictures)
    yield "pictures", ", ".join(links)
    name = entry.name if entry.kind in (CLAIM, HARD_CASE, VALUE) else entry.experiment
    yield "command", f"<code>python -m validation {COMMANDS[entry.kind]} {escape(name)}</code>"
    origins = kept or (read_origin(ROOT / "figures", pictures[0].name) if pictures and not runs else {})
    if origins.get("commit"):
        place = (origins.get("machine") or {}).get("processor", "")
        yield "measured", escape(f"{origins['date']}, commit {origins['commit'][:8]}, {place}")
