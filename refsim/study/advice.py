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
from dataclasses import dataclass
from typing import Any

from refsim.backends.arrays import unavailable
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.tables import in_bytes, in_time
from refsim.scene.files import parse_scene
from refsim.scene.scene import Scene
from refsim.study.cost import Prediction, predict

THREADS = 2  # CPU threads of the table's timings


@dataclass(frozen=True)
class Advice:
    """One row of the table.

    observable  its entry in the table
    error       relative error of the row [-], at most the one that was given
    cell        the row: keys "cpu", "gpu", "peer", or "no_meaning"
    own         seconds on this machine; NaN where there is no scene to predict them from
    own_note    what they are, or why there are none
    scene       TOML text of the scene; "" where there is none
    """

    observable: Mapping[str, Any]
    error: float
    cell: Mapping[str, Any]
    own: float = math.nan
    own_note: str = ""
    scene: str = ""


@functools.cache
def table() -> dict[str, dict[str, Any]]:
    """The table's observables by name."""
    text = (importlib.resources.files("refsim") / "study" / "answers.json").read_text(encoding="utf-8")
    return {row["name"]: row for row in json.loads(text)["observables"]}


def find(observable: str, error: float) -> Advice:
    """The row for an observable and a relative error: that of the largest error in the table that is no larger.

    Raises InputError for an unknown observable and for an error that no row has.
    """
    known = table()
    if observable not in known:
        raise InputError(f"advise: there is no observable {observable!r}; {suggestion(observable, known)}")
    row = known[observable]
    if not 0 < error < 1:
        raise InputError(f"advise: an error of {error:g} is not possible; give a share between 0 and 1, 0.01 for 1 %.")
    fits = [cell for cell in row["answers"] if cell["error"] <= error * (1 + 1e-9)]
    if not fits:
        least = min(cell["error"] for cell in row["answers"])
        raise InputError(
            f"advise: the table ends at an error of {least:g}; give that or more, or measure with refsim study."
        )
    cell = max(fits, key=lambda cell: cell["error"])
    return Advice(row, cell["error"], cell, scene=named(cell).get("scene", ""))


def named(cell: Mapping[str, Any]) -> Mapping[str, Any]:
    """The setting that a row names: the advised one, or the one read fastest where no timing has settled."""
    cpu: Mapping[str, Any] = cell.get("cpu", {})
    return cpu.get("read", cpu)


def scaled(advice: Advice, backend: str = "cpu") -> Advice:
    """The advice with seconds on this machine, predicted with constants that are measured here (some seconds)."""
    if not advice.scene:
        return advice
    cpu = named(advice.cell)
    reason = unavailable(backend)
    if reason is not None:
        return _with(advice, math.nan, f"not predicted: {reason}")
    scene: Scene = parse_scene(advice.scene, advice.observable["name"])
    found: Prediction | None = predict(scene, backend, threads=THREADS if backend == "cpu" else None)
    assert found is not None
    # the setting may reach the error before its run ends
    share = min(cpu["seconds"] / cpu["whole"], 1.0) if cpu["whole"] else 1.0
    where = f"{THREADS} CPU threads" if backend == "cpu" else "the GPU"
    note = f"predicted for {where} of this machine"
    return _with(advice, found.seconds * share, f"{note}; {found.note}" if found.note else note)


def _with(advice: Advice, seconds: float, note: str) -> Advice:
    return Advice(advice.observable, advice.error, advice.cell, seconds, note, advice.scene)


def text_of(advice: Advice, gpu: bool = False) -> str:
    """The row as text."""
    row, cell = advice.observable, advice.cell
    head = f"{row['words']}: an error of {percent(advice.error)} {row['relative']}"
    if "no_meaning" in cell:
        return f"{head}\n  no meaning: {cell['no_meaning']}"
    cpu = cell["cpu"]
    lines = [head]
    if "why" in cpu:
        lines.append(f"  {cpu['why']}")
    if "read" in cpu:
        read = cpu["read"]
        lines.append(f"  read       {read['setting']}; keeps {percent(read['keeps'])} ({read['keeps_own']})")
        span = f"{in_time(read['fastest'])} to {in_time(read['slowest'])}"
        lines.append(f"  measured   {span} on {row['machine']} ({', '.join(row['dates'])}), not settled")
    if "why" not in cpu:
        lines.append(f"  setting    {cpu['setting']}; keeps {percent(cpu['keeps'])} ({cpu['keeps_own']})")
        lines.append(f"  measured   {in_time(cpu['seconds'])} on {row['machine']} ({', '.join(row['dates'])})")
        if cpu["bytes"]:
            lines.append(f"  memory     {in_bytes(cpu['bytes'])} in fields")
    if math.isfinite(advice.own):
        lines.append(f"  here       {in_time(advice.own)}, {advice.own_note}")
    elif advice.own_note:
        lines.append(f"  here       {advice.own_note}")
    if gpu:
        lines.append(f"  GPU        {_gpu(cell['gpu'], row)}")
    if cell["peer"]:
        peer = cell["peer"]
        lines.append(f"  best peer  {peer.get('why') or in_time(peer['seconds']) + ', ' + peer['setting']}")
    lines += [f"  note       {note}" for note in cpu["notes"]]
    if row["remark"]:
        lines.append(f"  note       {row['remark']}")
    return "\n".join(lines)


def _gpu(found: Mapping[str, Any] | None, row: Mapping[str, Any]) -> str:
    if found is None:
        return "not measured"
    return found.get("why") or f"{in_time(found['seconds'])} on {row['gpu']}, {found['setting']}"


def percent(value: float) -> str:
    """A share in per cent, two digits."""
    return f"{float(f'{100 * value:.2g}'):g} %"
