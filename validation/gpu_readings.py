"""Readings of a panel that a GPU gave, for machines without one.

On a machine with a GPU `python -m validation accuracy PANEL --backend cuda` writes
`gpu_reports/accuracy_cost_PANEL.json`, the results of all of the panel's runs. It brings their points into the panel of
every other machine, with the device and the date. They stand beside that machine's own points: its front and its advice
are without them.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from refsim.backends.arrays import unavailable
from refsim.backends.runtime import simulated
from validation.experiment import Options, Results, Run
from validation.results import Result, finite
from validation.running import Context

REPORTS = Path(__file__).resolve().parent / "gpu_reports"


def keep(panel: str, runs: Sequence[Run], results: Results, options: Options, folder: Path = REPORTS) -> Path | None:
    """Write the panel's report: of a GPU, at the published sizes, and of all runs that are not skipped."""
    if options.quick or options.backend != "cuda" or simulated():
        return None
    if not results or any(run.key not in results for run in runs if not run.skip):
        return None
    file = folder / f"accuracy_cost_{panel}.json"
    found = {key: {"about": result.about, "values": finite(result.values)} for key, result in results.items()}
    file.write_text(json.dumps({"runs": found}, allow_nan=False) + "\n")
    return file


def gpu_runs(panel: str, options: Options, folder: Path = REPORTS) -> list[Run]:
    """The run that reads the panel's report; none on backend cuda, for the quick size, or without a report."""
    file = folder / f"accuracy_cost_{panel}.json"
    if options.quick or options.backend == "cuda" or not file.exists():
        return []
    digest = hashlib.sha256(file.read_bytes()).hexdigest()[:12]
    return [Run("on_gpu", reported, {"file": file.name, "digest": digest}, estimate=0.1)]


def reported(context: Context, file: str, digest: str, folder: Path = REPORTS) -> Result:
    """The report's readings on backend cuda, named as those of a GPU."""
    runs = json.loads((folder / file).read_text())["runs"].values()
    dates = sorted({run["about"]["date"] for run in runs})
    readings = []
    for run in runs:
        for reading in run["values"].get("readings", ()):
            if reading["knobs"].get("backend", "cuda") == "cuda":
                knobs = {**reading["knobs"], "backend": "cuda", "reported": dates[-1]}
                named = {"key": f"cuda_{reading['key']}", "words": _words(reading["words"]), "knobs": knobs}
                readings.append({**reading, **named})
    where: Mapping[str, Any] = next(r["values"]["where"] for r in runs if r["values"].get("readings"))
    return Result({"readings": readings, "where": {**where, "date": dates[-1]}})


def _words(words: str) -> str:
    """A setting that names its backend already is as it is."""
    return words if "cuda" in words else f"{words}, on a GPU"


def without_gpu(panel: str, options: Options, folder: Path = REPORTS) -> list[str]:
    """What a panel says of the backend cuda where it has no point of it."""
    if options.backend == "cuda" or gpu_runs(panel, options, folder):
        return []
    return [f"backend cuda: {unavailable('cuda') or 'measured with --backend cuda'}"]
