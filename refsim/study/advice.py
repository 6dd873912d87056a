"""What an accuracy costs in the papers' scenes: the table of docs/accuracy_cost.md, and its rows on this machine.

The table, answers.json beside this module, has for each observable and relative error the cheapest setting that was
measured; `validation/answers.py` in the repository makes it.
"""

from __future__ import annotations

import functools
import importlib.resources
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from refsim.backends.arrays import unavailable
from refsim.backends.threads import threads_for
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.tables import in_bytes, in_time
from refsim.scene.files import parse_scene
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.study.cost import Prediction, predict

MOST_THREADS = 2  # for the CPU, as in the table's timings


@dataclass(frozen=True)
class Advice:
    """One row of the table.

    observable  its entry in the table
    error       relative error [-]: that of the row, or the one that was given where the row's setting keeps it
    cell        the row: keys "cpu", "gpu", "peer", or "no_meaning"
    kind        "cpu" or "gpu": which of the row's settings is meant
    own         seconds on this machine; NaN where there is no scene to predict them from
    own_note    what they are, or why there are none
    scene       TOML text of the scene; "" where there is none
    """

    observable: Mapping[str, Any]
    error: float
    cell: Mapping[str, Any]
    kind: str = "cpu"
    own: float = math.nan
    own_note: str = ""
    scene: str = ""


@functools.cache
def table() -> dict[str, dict[str, Any]]:
    """The table's observables by name."""
    text = (importlib.resources.files("refsim") / "study" / "answers.json").read_text(encoding="utf-8")
    return {row["name"]: row for row in json.loads(text)["observables"]}


def find(observable: str, error: float, kind: str = "cpu") -> Advice:
    """The row for an observable and a relative error: that of the largest error in the table that is no larger.

    Where that row has no meaning, the row above it counts if its setting keeps the error.

    Raises InputError for an unknown observable and for an error that no row has.
    """
    known = table()
    if observable not in known:
        raise InputError(f"advise: there is no observable {observable!r}; {suggestion(observable, known)}")
    row = known[observable]
    if not 0 < error < 1:
        raise InputError(f"advise: an error of {error:g} is not possible; give a share between 0 and 1, 0.01 for 1 %.")
    cells = sorted(row["answers"], key=lambda cell: -cell["error"])
    first = next((k for k, cell in enumerate(cells) if cell["error"] <= error * (1 + 1e-9)), None)
    if first is None:
        raise InputError(
            f"advise: the table ends at an error of {cells[-1]['error']:g}; give that or more, or measure with refsim"
            " study."
        )
    cell, kept = cells[first], cells[first]["error"]
    if "no_meaning" in cell and first and kept < error and named(cells[first - 1], kind).get("keeps", 1.0) <= error:
        cell, kept = cells[first - 1], error
    return Advice(row, kept, cell, kind, scene=named(cell, kind).get("scene", ""))


def named(cell: Mapping[str, Any], kind: str = "cpu") -> Mapping[str, Any]:
    """The setting that a row names: the advised one, or the one read fastest where no timing has settled."""
    found: Mapping[str, Any] = cell.get(kind) or {}
    return found.get("read", found)


def scaled(advice: Advice) -> Advice:
    """The advice with seconds on this machine, predicted with constants that are measured here (some seconds)."""
    if not advice.scene:
        return advice
    backend = "cuda" if advice.kind == "gpu" else "cpu"
    setting = named(advice.cell, advice.kind)
    reason = unavailable(backend)
    if reason is not None:
        return replace(advice, own_note=f"not predicted: {reason}")
    scene: Scene = parse_scene(advice.scene, advice.observable["name"])
    threads = min(MOST_THREADS, threads_for(make_plan(scene).grid.count)) if backend == "cpu" else None
    found: Prediction | None = predict(scene, backend, threads=threads)
    assert found is not None
    # the setting may reach the error before its run ends
    share = min(setting["seconds"] / setting["whole"], 1.0) if setting["whole"] else 1.0
    where = "the GPU" if threads is None else "one CPU thread" if threads == 1 else f"{threads} CPU threads"
    note = f"predicted for {where} of this machine"
    return replace(advice, own=found.seconds * share, own_note=f"{note}; {found.note}" if found.note else note)


def text_of(advice: Advice) -> str:
    """The row as text."""
    row, cell = advice.observable, advice.cell
    head = f"{row['words']}: an error of {percent(advice.error)} {row['relative']}"
    if "no_meaning" in cell:
        return f"{head}\n  no meaning: {cell['no_meaning']}"
    found, gpu = cell[advice.kind], advice.kind == "gpu"
    if found is None:
        return f"{head}\n  not measured on a GPU; leave --gpu out."
    lines, setting = [head], named(cell, advice.kind)
    where = row["gpu"] if gpu else f"{row['machine']} ({', '.join(row['dates'])})"
    if "why" in found:
        lines.append(f"  {found['why']}")
    if "setting" in setting:
        took = in_time(setting["seconds"])
        if setting is not found:
            took = f"{in_time(setting['fastest'])} to {in_time(setting['slowest'])}, not settled,"
        elif setting["starts"]:
            took += f" ({' to '.join(map(in_time, setting['starts']))} over the starts)"
        lines.append(f"  setting    {setting['setting']}; keeps {percent(setting['keeps'])} ({setting['keeps_own']})")
        lines.append(f"  measured   {took} on {where}")
        if setting["bytes"]:
            lines.append(f"  memory     {in_bytes(setting['bytes'])} in fields")
    if math.isfinite(advice.own):
        lines.append(f"  here       {in_time(advice.own)}, {advice.own_note}")
    elif advice.own_note:
        lines.append(f"  here       {advice.own_note}")
    if cell["peer"] and not gpu:
        peer = cell["peer"]
        lines.append(f"  best peer  {peer.get('why') or in_time(peer['seconds']) + ', ' + peer['setting']}")
    lines += [f"  note       {note}" for note in found["notes"]]
    if row["remark"]:
        lines.append(f"  note       {row['remark']}")
    return "\n".join(lines)


def percent(value: float) -> str:
    """A share in per cent, two digits."""
    return f"{float(f'{100 * value:.2g}'):g} %"
