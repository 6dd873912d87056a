"""The table and the pictures of docs/accuracy_cost.md, from the answers that the stored panels give."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from validation.answers import FIGURES, OBSERVABLES, ROOT, as_json, duration, percent, report, table
from validation.drawing import save_picture, style
from validation.filling import replaced

TABLE = ROOT / "refsim" / "study" / "answers.json"
PAGE = ROOT / "docs" / "accuracy_cost.md"

HOLLOW = "\u25cb"  # before what has not settled, as it is drawn


BELOW = "\u2020"  # beside an error below the uncertainty of the reference


ABSENT = "\u2013"  # not measured


def markdown(found: Mapping[str, Any]) -> list[str]:
    """The page's table: a line for an observable and the errors of equal answers."""
    lines = ["| observable | error | cheapest setting | keeps | CPU, at most 2 threads | GPU | memory | best peer |"]
    lines.append("| --- | --: | --- | --: | --: | --: | --: | --: |")
    for row in found["observables"]:
        name = f"[{row['words']}]({row['page']}), `{row['name']}`; {row['relative']}"
        groups: dict[tuple[str, ...], list[str]] = {}
        for cell in row["answers"]:
            groups.setdefault(tuple(_columns(cell, row)), []).append(_error(cell["error"], row))
        for columns, errors in groups.items():
            lines.append(f"| {name} | {', '.join(errors)} | {' | '.join(columns)} |")
            name = ""
    return lines


def _error(error: float, row: Mapping[str, Any]) -> str:
    """An error of the table, in the observable's own unit beside where that is another one."""
    scale = OBSERVABLES[row["name"]].scale
    own = "" if scale in (1.0, 100.0) else f" ({error * scale:.2g} {row['unit']})"
    return percent(error) + own


def _keeps(named: Mapping[str, Any], cell: Mapping[str, Any], row: Mapping[str, Any]) -> str:
    """An error that a setting keeps; in the observable's own unit, too, where its number is another one."""
    observable = OBSERVABLES[row["name"]]
    own = f" ({named['keeps_own']})" if observable.converged or observable.scale not in (1.0, 100.0) else ""
    return percent(named["keeps"]) + own + (f" {BELOW}" if cell["error"] < row["uncertainty"] else "")


def _columns(cell: Mapping[str, Any], row: Mapping[str, Any]) -> list[str]:
    """Cells behind the error: setting, what it keeps, seconds, seconds on a GPU, memory, the best peer's seconds."""
    if "no_meaning" in cell:
        return [f"no meaning: {cell['no_meaning']}", "", "", "", "", ""]
    cpu = cell["cpu"]
    peer = "" if cell["peer"] is None else _of_peer(cell["peer"])
    if "nearest" in cpu:
        said = f"not reached; nearest: {cpu['nearest']['setting']}"
        return [said, _keeps(cpu["nearest"], cell, row), "", _on_gpu(cell["gpu"]), "", peer]
    named = cpu.get("read") or cpu
    if "setting" not in named:
        return [cpu["why"], "", "", _on_gpu(cell["gpu"]), "", peer]
    said = f"{HOLLOW} {named['setting']}" if "read" in cpu else named["setting"]
    memory = in_bytes(named["bytes"]) if named.get("bytes") else ""
    return [said, _keeps(named, cell, row), _time(cpu), _on_gpu(cell["gpu"]), memory, peer]


def _time(cell: Mapping[str, Any]) -> str:
    """Seconds of an advised setting, with those of its starts where they differ; of an unsettled one the range."""
    if "read" in cell:
        return f"{HOLLOW} {duration(cell['read']['fastest'])} to {duration(cell['read']['slowest'])}"
    starts = " to ".join(map(duration, cell["starts"]))
    return f"{duration(cell['seconds'])} (starts: {starts})" if starts else duration(cell["seconds"])


def _on_gpu(cell: Mapping[str, Any] | None) -> str:
    if cell is None:
        return ABSENT
    return f"not reached ({percent(cell['nearest']['keeps'])})" if "nearest" in cell else _time(cell)


def _of_peer(peer: Mapping[str, Any]) -> str:
    if "seconds" in peer:
        return f"{duration(peer['seconds'])} ({peer['program']})"
    if "fastest" in peer:
        return f"○ {duration(peer['fastest'])} to {duration(peer['slowest'])} ({peer['program']})"
    return f"not reached ({peer['program']}: {percent(peer['keeps'])})" if "keeps" in peer else peer["why"]


def notes(row: Mapping[str, Any]) -> list[str]:
    """What the table leaves out of an observable's row: why a setting is not advised or was passed over, and peers."""
    said: dict[str, list[str]] = {}

    def add(words: str, error: float) -> None:
        said.setdefault(words, []).append(percent(error))

    for cell in row["answers"]:
        if "no_meaning" in cell:
            continue
        for own in (cell["cpu"], cell["gpu"] or {"notes": ()}):
            if "read" in own:
                add(f"{HOLLOW} {own['read']['setting']}: {own['read']['unsettled']}", cell["error"])
            elif own is cell["gpu"] and "setting" in own:
                add(own["setting"], cell["error"])
            for note in own["notes"]:
                if not note.startswith("below the uncertainty"):
                    add(note, cell["error"])
        peer = cell["peer"] or {}
        if peer:
            add(peer.get("why") or f"best peer {peer['setting']}", cell["error"])
    return [f"- {', '.join(errors)}: {words}." for words, errors in said.items()]


def in_bytes(value: float) -> str:
    """Bytes of the fields, three digits."""
    for unit, size in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if value >= size:
            return f"{value / size:.3g} {unit}"
    return f"{value:g} B"


def pictures(found: Mapping[str, Any]) -> list[str]:
    """The page's pictures: one for each observable that was measured, with the notes to its row."""
    lines = []
    for row in found["observables"]:
        if "missing" in row:
            continue
        lines += [f"### {row['words'][0].upper()}{row['words'][1:]}", ""]
        lines += [f"![Error against time: {row['words']}](../figures/accuracy_cost_{row['name']}.png)", ""]
        gpu = f"; GPU: {row['gpu']}" if row["gpu"] else ""
        remark = f" {row['remark'][0].upper()}{row['remark'][1:]}." if row["remark"] else ""
        lines += [f"Measured on {row['machine']} ({', '.join(row['dates'])}){gpu}.{remark}", ""]
        listed = notes(row)
        lines += [*listed, ""] if listed else []
    return lines[:-1]


def page(text: str, found: Mapping[str, Any]) -> str:
    """docs/accuracy_cost.md with its generated parts renewed."""
    text = replaced(text, "answers", markdown(found), PAGE)
    return replaced(text, "pictures", pictures(found), PAGE)


def has_parts(data: Mapping[str, Any]) -> bool:
    """Whether a panel knows more of its points than their error and time: parts of the time, curves, distributions."""
    return any(len(p["parts"]) > 1 or p["curve"] or p["distribution"] for p in data["points"].values())


def write() -> list[Path]:
    """Renew page, packaged table and pictures from the stored panels; returns their paths."""
    import matplotlib.pyplot as plt

    from validation.accuracy_picture import answer_picture, parts_picture

    found = table()
    TABLE.write_text(as_json(found))
    PAGE.write_text(page(PAGE.read_text(), found))
    made = [TABLE, PAGE]
    for name in OBSERVABLES:
        data = report(name)
        for ending, draw in (("", answer_picture), ("_parts", parts_picture)):
            if ending and not has_parts(data):
                continue
            path = FIGURES / f"accuracy_cost_{name}{ending}.png"
            with style():
                figure = draw(data)
                save_picture(figure, path)
            plt.close(figure)
            made.append(path)
    return made
