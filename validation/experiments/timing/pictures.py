"""The picture of table 1, drawn from its data file alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, stacked_bars
from validation.experiment import Picture, Results
from validation.experiments.timing.runs import STEADY, grouped

COLOURS = {
    "neighbours": GREY, "density": SKY, "forces": BLUE, "detection": GREEN, "tension": VERMILION, "other": PURPLE,
}  # fmt: skip


def steady_data(results: Results) -> dict[str, Any]:
    """Table 1: seconds to steady state by stage, and the paper's column."""
    words = {
        "steady_default": "all pairs", "steady_default_detection": "all pairs, detection on",
        "steady_soft": "soft pairs", "steady_soft_detection": "soft pairs, detection on",
        "steady_text": "the paper's text: its surface set",
        "steady_one_sided": "the paper's words: force on\nsurface particles only",
    }  # fmt: skip
    bars = []
    for key, label in words.items():
        if key not in results:
            continue
        values, steady = results[key].values, results[key].values["steady"]
        upto = steady or {"wall": values["seconds"], "stages": values["series"]["stages"][-1]}
        share = grouped(upto["stages"])
        share["other"] = max(upto["wall"] - sum(share.values()), 0.0)
        bars.append({
            "label": label, "steady": steady is not None, "stopped": values["stopped"], "seconds": upto["wall"],
            "stages": share,
        })  # fmt: skip
    about = results["steady_default"].about
    return {
        "title": "Table 1: seconds to steady state", "particles": results["steady_default"].values["particles"],
        "machine": about["machine"], "date": about["date"], "own_column_of_the_paper_s": 30.3, "bars": bars,
    }  # fmt: skip


def steady_picture(data: Mapping[str, Any]) -> Any:
    """One bar a reading of the tension, split into stages; the paper's value as a line."""
    bars, paper, machine = data["bars"], data["own_column_of_the_paper_s"], data["machine"]
    figure, axes = plt.subplots(figsize=(8.6, 0.55 * len(bars) + 1.9))
    place = list(range(len(bars)))[::-1]
    ends = stacked_bars(axes, [bar["stages"] for bar in bars], COLOURS, place, 0.62, edgecolor="white", lw=0.6)
    for bar, y, end in zip(bars, place, ends):
        note = f", stopped: {bar['stopped']}" if bar["stopped"] else "" if bar["steady"] else ": not steady"
        axes.text(max(bar["seconds"], end), y, f"  {bar['seconds']:.1f} s{note}", va="center", fontsize=8.5)
    axes.axvline(paper, color=ORANGE, ls="--", lw=1.6)
    words = f" {paper} s in the paper\n (its machine, its criterion)"
    axes.text(paper, len(bars) - 0.45, words, fontsize=8, va="top", color=GREY)
    axes.set_yticks(place, [bar["label"] for bar in bars])
    axes.set(xlim=(0, 1.35 * max(paper, *(bar["seconds"] for bar in bars))), ylim=(-0.6, len(bars) - 0.3))
    axes.set(xlabel="wall time [s]", title=f"Seconds to steady state, {data['particles']:,} particles")
    axes.grid(True, axis="x")
    figure.legend(loc="outside lower center", ncols=6)
    words = f"{machine['processor']}, {machine['cores']} cores"
    axes.set_title(words, loc="right", fontsize=8, color=GREY, fontweight="normal")
    return figure


PICTURES = (Picture("table_1", steady_data, steady_picture, tuple(STEADY)),)
