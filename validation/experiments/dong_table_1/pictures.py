"""Picture of Dong's table 1."""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLUE, GREY, ORANGE
from validation.experiment import Results
from validation.experiments.dong import runs
from validation.experiments.dong import scene as scenes

COLOURS = {"dong": BLUE, "iif": ORANGE, "csf": GREY}


def data(results: Results) -> dict[str, Any]:
    """Milliseconds of a frame, turn by turn."""
    rows: dict[tuple[str, str], list[float]] = {}
    for result in results.values():
        values = result.values
        rows.setdefault((values["case"], values["model"]), []).append(1e3 * runs.per_frame(values))
    first = next(iter(results.values()))
    particles = {result.values["case"]: result.values["particles"] for result in results.values()}
    return {
        "title": "Dong, table 1: time per frame of 5 ms",
        "machine": first.about.get("machine"),
        "date": first.about.get("date"),
        "threads": first.values["threads"],
        "particles": particles,
        "rows": [
            {"case": case, "model": model, "frame_ms": found, "median_ms": statistics.median(found)}
            for (case, model), found in rows.items()
        ],
    }


def picture(data: Mapping[str, Any]) -> Any:
    """A group of bars for each scene; marks are the turns."""
    words = {"droplet": "the cube, {:,} particles", "oil": "twelve drops of one oil, {:,} particles"}
    cases = list(data["particles"])
    longest = max(max(r["frame_ms"]) for r in data["rows"])
    figure, axes = plt.subplots(figsize=(7.6, 3.0))
    for k, (model, colour) in enumerate(COLOURS.items()):
        for line, case in enumerate(cases):
            found = next(r["frame_ms"] for r in data["rows"] if (r["case"], r["model"]) == (case, model))
            y = -line + 0.27 * (1 - k)
            label = scenes.MODELS[model] if line == 0 else None
            axes.barh(y, statistics.median(found), 0.24, color=colour, label=label)
            axes.plot(found, np.full(len(found), y), "|", color="black", ms=7)
            axes.text(max(found) + 0.012 * longest, y, f"{statistics.median(found):.1f}", va="center", fontsize=8)
    axes.set_yticks([-line for line in range(len(cases))], [words[c].format(data["particles"][c]) for c in cases])
    said = f"milliseconds a frame, {data['threads'] or 'all'} threads; bars: medians, strokes: single turns"
    axes.set(xlabel=said, xlim=(0, 1.1 * longest), title=data["title"])
    axes.grid(True, axis="x")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure
