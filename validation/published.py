"""Which published number is still true: `python -m validation stale`.

`published.json` holds a record of every picture, claim and hard case: the digest of the runs behind it (`results`),
date, commit, machine and seconds. A record holds as long as the runs of today have the same digest. Otherwise the code
behind the number has changed since it was measured, and the number is stale until it is measured again.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from validation.checks import CLAIM, HARD_CASE
from validation.experiment import Experiment, Options, Part, Run, chosen
from validation.results import Result, result_folder
from validation.tables import Table

ROOT = Path(__file__).resolve().parent.parent
RECORDS = Path(__file__).with_name("published.json")
PAGES = ROOT / "docs"
PICTURE = "picture"
HOLDS, STALE = "holds", "stale"


@dataclass(frozen=True)
class Item:
    """Something published, and the runs behind it.

    kind     picture, claim or hard case
    folder   in which its results are kept
    command  which measures it again
    """

    kind: str
    name: str
    folder: str
    command: str
    runs: Sequence[Run]

    @property
    def key(self) -> str:
        """Its name in the records."""
        return f"{self.kind} {self.name}"

    def digest(self) -> str:
        """Digest of its runs: their parameters, and the code of all modules that they import."""
        names = [result_folder(Path(), self.folder, r.key, r.function, r.parameters).name for r in self.runs]
        return hashlib.sha256("\n".join(sorted(names)).encode()).hexdigest()[:16]


def items_of(part: Part, command: str) -> list[Item]:
    """The pictures, and the hard cases, of a part."""
    by_key = {run.key: run for run in part.runs}
    made = []
    for picture in part.pictures:
        if picture.needs and not set(picture.needs) & set(by_key):
            continue  # of the quick size alone
        runs = [by_key[key] for key in picture.needs if key in by_key] or list(part.runs)
        made.append(Item(PICTURE, picture.name, part.folder, command, runs))
    if part.kind == HARD_CASE:
        behind = {key for picture in part.pictures for key in picture.needs}
        made += [
            Item(HARD_CASE, r.key, part.folder, f"stability {r.key}", [r]) for r in part.runs if r.key not in behind
        ]
    return made


def everything(known: Mapping[str, Experiment]) -> dict[str, Item]:
    """What is published, by its name in the records."""
    from validation import accuracy, claims, stability

    options, made = Options(), list[Item]()
    for name, experiment in known.items():
        made += items_of(experiment.part(options), f"run {name}")
        made += items_of(stability.part_of(experiment, options), f"stability {name}")
    for name, panel in accuracy.panels(known).values():
        made += items_of(accuracy.part_of(name, panel, options), f"accuracy {panel.name}")
    for claim in claims.read_claims().values():
        how = known[claim.experiment].claims.get(claim.name)
        if how is not None:
            made.append(Item(CLAIM, claim.name, claim.experiment, f"claims {claim.name}", how.runs(options)))
    return {item.key: item for item in made}


def read_records(path: Path | None = None) -> dict[str, dict[str, Any]]:
    """The records by name; none without the file."""
    path = path or RECORDS
    return json.loads(path.read_text()) if path.exists() else {}


def record(measured: Iterable[tuple[Item, Sequence[Result]]], options: Options, path: Path | None = None) -> None:
    """Keep what was measured at the published sizes, from the results behind each item."""
    if options.quick or options.backend != "cpu" or options.figures.resolve() != ROOT / "figures":
        return
    if options.results.resolve() != ROOT / "results":
        return
    records = read_records(path)
    for item, results in measured:
        about = [result.about for result in results if result.about]
        if not about:
            continue
        latest = max(about, key=lambda each: str(each.get("date")))
        records[item.key] = {
            "digest": item.digest(),
            "date": latest.get("date"),
            "commit": latest.get("commit"),
            "machine": latest.get("machine"),
            "seconds": round(sum(each.get("seconds", 0.0) for each in about), 1),
        }
    write_records(records, path)


def write_records(records: Mapping[str, Any], path: Path | None = None) -> None:
    """Write the records, one a line."""
    lines = [f"{json.dumps(key)}: {json.dumps(records[key])}" for key in sorted(records)]
    (path or RECORDS).write_text("{\n" + ",\n".join(lines) + "\n}\n")


@dataclass(frozen=True)
class Standing:
    """An item, what is recorded of it, and whether the record holds."""

    item: Item
    record: Mapping[str, Any]

    @property
    def state(self) -> str:
        """HOLDS or STALE; what was never recorded is stale."""
        return HOLDS if self.record.get("digest") == self.item.digest() else STALE

    @property
    def seconds(self) -> float:
        """What measuring takes: as long as the last time, else as its runs estimate [s]."""
        return float(self.record.get("seconds") or sum(run.estimate for run in self.item.runs))


def standings(names: Sequence[str], known: Mapping[str, Experiment], path: Path | None = None) -> list[Standing]:
    """The items of these names or kinds, all without. Raises InputError for a name that there is not."""
    items, records = everything(known), read_records(path)
    by_name: dict[str, list[Item]] = {}
    for item in items.values():
        for name in (item.name, item.kind):
            by_name.setdefault(name, []).append(item)
    some = [item for each in chosen(names, by_name, "published number or kind") for item in each]
    return [Standing(item, records.get(item.key, {})) for item in {item.key: item for item in some}.values()]


def table(found: Sequence[Standing]) -> Table:
    """What is stale, with the command and the time that renewing takes."""
    rows = [
        [s.item.kind, s.item.name, words_of(s), duration(s.seconds), f"python -m validation {s.item.command}"]
        for s in found
        if s.state == STALE
    ]
    total = duration(sum(s.seconds for s in found if s.state == STALE))
    return Table(
        f"Stale: {len(rows)} of {len(found)}; renewing takes {total} of one machine",
        ["kind", "name", "measured", "takes", "command"],
        rows,
    )


def words_of(standing: Standing) -> str:
    """Date and commit of a record, and the commit at which its bits were last compared."""
    date, commit, same = (standing.record.get(name) for name in ("date", "commit", "same_bits_at"))
    if not date:
        return "no record"
    return f"{date}{f', {commit[:7]}' if commit else ''}{f'; same bits at {same[:7]}' if same else ''}"


def duration(seconds: float) -> str:
    """Seconds, minutes or hours."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


# Pages


def page_table(found: Sequence[Standing]) -> str:
    """The table of docs/published.md."""
    lines = ["| number | command | measured | machine | seconds | state |", "| --- | --- | --- | --- | --- | --- |"]
    for s in found:
        machine = s.record.get("machine") or {}
        where = machine.get("gpu") or machine.get("processor", "")
        where += f", {machine['cores']} cores" if "cores" in machine else ""
        cells = [s.item.key, f"`{s.item.command}`", words_of(s), where, f"{s.seconds:.0f}", s.state]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


BEGIN, END = "<!-- stale -->", "<!-- end of stale -->"
SHOWN = re.compile(r"\]\((?:\.\./)+figures/([\w]+)\.(?:png|webp)\)")


def marked(text: str, stale: Iterable[str], link: str = "published.md") -> str:
    """A page with a last line that names the stale ones among its pictures; without one where none is stale."""
    text = re.sub(rf"\n*{BEGIN}.*?{END}\n?", "\n", text, flags=re.DOTALL).rstrip("\n") + "\n"
    shown = [name for name in dict.fromkeys(SHOWN.findall(text)) if name in set(stale)]
    if not shown:
        return text
    names = ", ".join(f"`{name}`" for name in shown)
    return f"{text}\n{BEGIN}\nMeasured before the code behind them last changed ([table]({link})): {names}.\n{END}\n"


def write_pages(found: Sequence[Standing], folder: Path | None = None) -> list[Path]:
    """Renew the table and the marks of stale pictures; returns the pages that changed."""
    folder, changed = folder or PAGES, []
    stale = {s.item.name for s in found if s.state == STALE and s.item.kind == PICTURE}
    for page in sorted(folder.glob("*.md")):
        text = page.read_text()
        if page.name == "published.md":
            before, _, rest = text.partition("<!-- table -->\n")
            after = rest.partition("<!-- end of table -->")[2]
            new = f"{before}<!-- table -->\n\n{page_table(found)}\n\n<!-- end of table -->{after}"
        else:
            new = marked(text, stale)
        if new != text:
            page.write_text(new)
            changed.append(page)
    return changed


def as_json(found: Sequence[Standing]) -> str:
    """One object: every item by name."""
    named = {s.item.key: {"state": s.state, "seconds": s.seconds, "command": s.item.command, **s.record} for s in found}
    return json.dumps(named, indent=1)
