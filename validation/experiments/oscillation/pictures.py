"""Tension by Rayleigh against tension by Laplace, drop by drop."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from validation.drawing import SKY, VERMILION
from validation.experiment import Results
from validation.measure.drops import MODELS
from validation.measure.sigma_map import WORST_MISFIT
from validation.results import real


def data(results: Results) -> dict[str, Any]:
    """Both tensions of every kicked drop whose frequency can be read."""
    names = ("model", "dim", "support", "stiffness", "radius", "seed", "laplace", "rayleigh", "misfit")
    rows = [
        {n: row[n] for n in names}
        for row in results["map"].values["rows"]
        if not row["stopped"] and math.isfinite(real(row.get("rayleigh"))) and row["misfit"] <= WORST_MISFIT
    ]
    now = [result.values for key, result in results.items() if key != "map"]
    fine = [
        {n: row[n] for n in names} for row in now if not row["stopped"] and math.isfinite(real(row.get("rayleigh")))
    ]
    return {"title": "Tension by Rayleigh against tension by Laplace", "drops": rows, "now": fine}


AGREE = 0.1  # relative difference up to which both measures agree
SHOWN = "akinci"  # the model whose drops stand out


def picture(data: Mapping[str, Any]) -> Any:
    """On the line a drop has one surface tension; above it something else holds the shape, too."""
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 5.0), sharey=True)
    share = ""
    for axes, dim in zip(panels, (2, 3)):
        axes.fill_between([0.3, 30], [0.3 * (1 - AGREE), 30 * (1 - AGREE)], [0.3 * (1 + AGREE), 30 * (1 + AGREE)],
                          color="#dddddd", lw=0, label="equal within 10 %")  # fmt: skip
        drops = [d for d in data["drops"] if d["dim"] == dim and d["laplace"] > 0]
        counted = []
        for own, colour, words in (
            ([d for d in drops if d["model"] != SHOWN], SKY, "other models"),
            ([d for d in drops if d["model"] == SHOWN], VERMILION, MODELS[SHOWN][0]),
        ):
            near = sum(abs(d["rayleigh"] / d["laplace"] - 1) <= AGREE for d in own)
            counted.append(f"{near} of {len(own)} drops of {words}")
            x, y = [d["laplace"] for d in own], [d["rayleigh"] for d in own]
            axes.plot(x, y, "o", ms=4.5, color=colour, mec="white", mew=0.4, label=words)
        share = f"3D: {counted[1]} and {counted[0]} have one surface tension"
        now = [d for d in data.get("now", ()) if d["dim"] == dim]
        if now:
            x, y = [d["laplace"] for d in now], [d["rayleigh"] for d in now]
            ring = {"marker": "o", "ms": 8, "mfc": "none", "mec": "black", "mew": 1.0, "ls": "none"}
            axes.plot(x, y, label=f"{MODELS[SHOWN][0]}, measured now", **ring)
        axes.set(xscale="log", yscale="log")
        ticks = (0.5, 1, 2, 5, 10, 20)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set(major_locator=FixedLocator(ticks), major_formatter=StrMethodFormatter("{x:g}"))
            axis.set(minor_locator=NullLocator())
        axes.set(xlim=(0.5, 12), ylim=(0.5, 27))
        beyond = sum(
            d["dim"] == dim and not (0.5 <= d["laplace"] <= 12 and 0.5 <= d["rayleigh"] <= 27) for d in data["drops"]
        )
        words = f"; {beyond} drops lie outside" if beyond else ""
        axes.set(title=f"{dim}D, mode n = 2{words}", xlabel="tension by the pressure jump, over the nominal one")
        axes.grid(True)
    panels[0].set_ylabel("tension by the frequency, over the nominal one")
    handles: dict[str, Any] = {}
    for axes in panels:
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels())}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=8)
    figure.suptitle(share, fontweight="bold")
    return figure
