"""Error against processor time of five flows: the papers' liquid, the one that rests, and those of other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from validation.experiment import Picture, Results

TITLES = {
    "vortices": "vortices, Re 100\n(velocity at 1 s, L2)",
    "tank": "tank at rest\n(speed at 4 s over c)",
    "cavity": "cavity, Re 100\n(centre-line velocity)",
    "dam": "dam break\n(front over the width)",
    "body": "floating cube\n(draught over its edge)",
}
LOOKS = {  # colour and marker
    ("refsim", "papers"): (VERMILION, "o", "refsim, the papers' liquid"),
    ("refsim", "rests"): (BLUE, "o", "refsim, the liquid that rests"),
    ("refsim", "corrected"): (GREEN, "o", "refsim, renormalised gradients"),
    ("PySPH", "wcsph"): (GREY, "s", "PySPH, WCSPH"),
    ("PySPH", "tvf"): (ORANGE, "s", "PySPH, transport velocity"),
    ("PySPH", "edac"): (PURPLE, "s", "PySPH, EDAC"),
    ("PySPH", "adami"): (SKY, "s", "PySPH, Adami et al. 2012"),
    ("SPlisHSPlasH", "dfsph"): ("black", "^", "SPlisHSPlasH, DFSPH"),
    ("SPlisHSPlasH", "wcsph"): (GREY, "^", "SPlisHSPlasH, WCSPH"),
}  # fmt: skip


def data(results: Results) -> dict[str, Any]:
    """[seconds, error, particles along a side] by flow, program and scheme."""
    lines: dict[str, dict[str, list[list[float]]]] = {}
    for result in results.values():
        row = result.values
        if "error" in row:
            point = [float(f"{row['seconds']:.3g}"), float(f"{row['error']:.4g}"), row["cells"]]
            lines.setdefault(row["flow"], {}).setdefault(f"{row['program']} {row['kind']}", []).append(point)
    return {"lines": lines}


def picture(data: Mapping[str, Any]) -> Any:
    """A part for each flow; errors in per cent."""
    figure, parts = plt.subplots(1, max(1, len(data["lines"])), figsize=(14.0, 5.2), squeeze=False)
    shown = {}
    for axes, (flow, kinds) in zip(parts[0], data["lines"].items()):
        for name, points in kinds.items():
            colour, marker, words = LOOKS[tuple(name.split())]  # type: ignore[index]
            seconds, errors, cells = zip(*sorted(points, key=lambda point: point[2]))
            (line,) = axes.plot(seconds, [100 * e for e in errors], color=colour, marker=marker, label=words)
            shown[words] = line
        axes.set(xscale="log", yscale="log", ylabel="error [%]", title=TITLES[flow])
        axes.set_xlabel(f"seconds of one processor\n(lines end at {cells[-1]:g} particles a side)")
        axes.grid(True)
        for grow, ends in ((axes.set_xlim, axes.get_xlim()), (axes.set_ylim, axes.get_ylim())):  # whole decades
            grow(10 ** math.floor(math.log10(ends[0])), 10 ** math.ceil(math.log10(ends[1])))
    figure.legend(shown.values(), shown.keys(), loc="outside lower center", ncols=3, fontsize=9)
    return figure


PICTURES = (Picture("other_liquids", data, picture),)
