"""Readings of a panel that a GPU gave, for machines without one.

On a machine with a GPU `python -m validation accuracy PANEL --backend cuda` stores
`results/accuracy_cost_PANEL/<run>-<digest>/result.json`. A copy of that file, `gpu_reports/accuracy_cost_PANEL.json`,
brings its points into the panel of every other machine, with the device and the date. They stand beside that machine's
own points: its front and its advice are without them.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from refsim.backends.arrays import unavailable
from validation.experiment import Options, Run
from validation.results import Result
from validation.running import Context

REPORTS = Path(__file__).resolve().parent / "gpu_reports"


def gpu_runs(panel: str, options: Options, folder: Path = REPORTS) -> list[Run]:
    """The run that reads the panel's report; none on backend cuda, for the quick size, or without a report."""
    file = folder / f"accuracy_cost_{panel}.json"
    if options.quick or options.backend == "cuda" or not file.exists():
        return []
    digest = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    return [Run("on_gpu", reported, {"file": file.name, "digest": digest}, estimate=0.1)]


def reported(context: Context, file: str, digest: str, folder: Path = REPORTS) -> Result:
    """The report's readings, named as those of a GPU."""
    document = json.loads((folder / file).read_text())
    where: dict[str, Any] = {**document["values"]["where"], "date": document["about"]["date"]}
    readings = []
    for reading in document["values"]["readings"]:
        knobs = {**reading["knobs"], "reported": where["date"]}
        named = {"key": f"cuda_{reading['key']}", "words": f"{reading['words']}, on a GPU", "knobs": knobs}
        readings.append({**reading, **named})
    return Result({"readings": readings, "where": where})


def without_gpu(panel: str, options: Options, folder: Path = REPORTS) -> list[str]:
    """What a panel says of the backend cuda where it has no point of it."""
    if options.backend == "cuda" or gpu_runs(panel, options, folder):
        return []
    return [f"backend cuda: {unavailable('cuda') or 'measured with --backend cuda'}"]
