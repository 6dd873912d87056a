"""Error against the number of particles along a side, of the papers' liquid and of one that rests."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import BLUE, GREEN, GREY, VERMILION
from validation.experiment import Picture, Results

WORDS = {
    "papers": "the papers' liquid", "rests": "advanced density, extrapolated walls (vortices: with shifting)",
    "corrected": "the same, renormalised gradients",
}  # fmt: skip
COLOURS = {"papers": VERMILION, "rests": BLUE, "corrected": GREEN}
PARTS = (
    ("vortices", "error", "velocity of Taylor-Green vortices, L2"),
    ("wave", "period_off", "period of a standing wave"),
    ("wave", "decay_off", "decay of a standing wave"),
)


def data(results: Results) -> dict[str, Any]:
    """Errors by flow, liquid and number of particles."""
    lines: dict[str, dict[str, list[list[float]]]] = {}
    for flow, name, label in PARTS:
        for key, result in results.items():
            row = result.values
            if key.startswith(flow):
                point = [row["cells"], float(f"{row[name]:.4g}")]
                lines.setdefault(label, {}).setdefault(row["kind"], []).append(point)
    return {"title": "Errors of two liquids", "lines": lines}


def picture(data: Mapping[str, Any]) -> Any:
    """A part for each quantity, errors in per cent."""
    figure, parts = plt.subplots(1, max(1, len(data["lines"])), figsize=(11.0, 3.8), squeeze=False)
    for axes, (title, kinds) in zip(parts[0], data["lines"].items()):
        for kind, points in kinds.items():
            cells, errors = zip(*sorted(points))
            axes.plot(cells, [100 * error for error in errors], marker="o", color=COLOURS[kind], label=WORDS[kind])
        axes.set(xscale="log", yscale="log", xlabel="particles along a side (waves: depth)", title=title)
        axes.set(ylabel="error [%]")
        axes.axhline(1.0, color=GREY, lw=0.8, ls=":")
        ticks = sorted({cells for points in kinds.values() for cells, _ in points})
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.minorticks_off()
        axes.grid(True)
    figure.legend(*parts[0][-1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle(data["title"], fontsize=11)
    return figure


PICTURES = (Picture("liquid", data, picture),)
