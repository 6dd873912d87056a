"""Errors of drops against the seconds that they take."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import GREY
from validation.experiments.laplace.pictures import COLOURS, STYLES
from validation.measure.drops import MODELS, base
from validation.results import real

SHOWN = (
    ("sigma", "tension by the jump, off the promised one"),
    ("frequency", "frequency of n = 2, off the promised one"),
    ("roughness", "roughness at rest"),
)
MARKS = {
    ("float32", "cpu"): "o",
    ("float64", "cpu"): "s",
    ("float32", "cuda"): "^",
    ("float64", "cuda"): "v",
    ("float64", "numpy"): "D",
}


def words_of(point: Mapping[str, Any]) -> str:
    """The model, and its kernels where they are not those of its base."""
    other = "" if point["kernels"] == base(point["model"])["kernels"] else f", {point['kernels']}"
    return MODELS[point["model"]][0] + other


def picture(data: Mapping[str, Any]) -> Any:
    """One line a model through its resolutions; below, the cheapest for each accuracy in words."""
    figure, panels = plt.subplots(1, 3, figsize=(12.0, 5.6), sharex=True)
    alive = [p for p in data["points"] if not p["stopped"] and real(p["seconds"]) > 0]
    names = ("model", "kernels", "dtype", "backend", "radius")
    front = {tuple(p[n] for n in names) for p in data["front"]}
    for axes, (name, label) in zip(panels, SHOWN):
        for model, kernels, dtype, backend in dict.fromkeys(tuple(p[n] for n in names[:4]) for p in alive):
            line = (model, kernels, dtype, backend)
            own = sorted((p for p in alive if tuple(p[n] for n in names[:4]) == line), key=lambda p: p["radius"])
            own = [p for p in own if real(p[name]) > 0]
            if not own:
                continue
            plain, based = (dtype, backend) == ("float32", "cpu"), kernels == base(model)["kernels"]
            if plain:
                style = STYLES[model] if based else ":"
                axes.plot([p["seconds"] for p in own], [p[name] for p in own], style, lw=1.1, color=COLOURS[model])
            for p in own:
                axes.plot(
                    p["seconds"], p[name], MARKS[dtype, backend], ms=1.5 + 0.45 * p["radius"], color=COLOURS[model],
                    mfc=COLOURS[model] if plain and based else "white", alpha=0.9,
                    label=words_of(p) if plain and p is own[0] else None,
                )  # fmt: skip
                if (*line, p["radius"]) in front:
                    axes.plot(p["seconds"], p[name], "o", ms=13, mfc="none", color=GREY, mew=0.9)
        axes.set(xscale="log", yscale="log", xlabel="seconds of the whole run")
        axes.set_title(label, fontsize=9.5)
        axes.grid(True, which="major")
        if name != "roughness":
            axes.axhline(0.05, color=GREY, lw=0.9, ls="--")
            axes.set_ylim(2e-4, 2)
    marks = [plt.Line2D([], [], ls="", marker=m, ms=6, color=GREY, mfc="none") for m in MARKS.values()]
    words = [f"{dtype}, {backend}" for dtype, backend in MARKS]
    seen = {(p["dtype"], p["backend"]) for p in alive}
    kept = [k for k, how in enumerate(MARKS) if how in seen]
    handles: dict[str, Any] = {}
    for axes in panels:
        handles |= {label: handle for handle, label in zip(*axes.get_legend_handles_labels())}
    handles |= {words[k]: marks[k] for k in kept}
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5, fontsize=8)
    said = []
    for entry in data["advice"]:
        p = entry["point"]
        what = f"{words_of(p)}, R = {p['radius']:g} d, {p['dtype']}, {p['seconds']:.0f} s" if p else "none"
        said.append(f"within {100 * entry['bar']:g} %: {what}")
    half = math.ceil(len(said) / 2)
    lines = "      ".join(said[:half]) + "\n" + "      ".join(said[half:])
    figure.suptitle(
        f"{data['title']}\nSeconds: {data['machines']}\nCheapest whose tension and frequency are both\n{lines}",
        fontsize=9.5,
        x=0.01,
        ha="left",
    )
    return figure
