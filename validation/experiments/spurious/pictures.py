"""Spurious speed and capillary number of drops at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import GREY
from validation.experiment import Results
from validation.experiments.laplace.pictures import COLOURS
from validation.measure.drops import MODELS
from validation.measure.sigma_map import at_base

# Quantity, what it is called, and the interval that is drawn; None: as the drops are.
SHOWN = (
    ("spurious", "rms speed over sqrt(sigma/(rho R))", None),
    ("capillary", "capillary number mu max|v|/sigma", None),
    ("momentum", "linear momentum over sum m|v|", (1e-9, 3.0)),
    ("angular_momentum", "angular momentum over sum m|x||v|", (1e-5, 3.0)),
    ("nn_5", "nearest neighbour, 5th percentile [d]", (0.0, 1.05)),
    ("roughness", "radius variation", None),
)


def data(results: Results) -> dict[str, Any]:
    """Every drop at the map's base."""
    names = ("model", "dim", "radius", "seed", *(name for name, _, _ in SHOWN))
    rows = [{n: r[n] for n in names} for r in results["map"].values["rows"] if at_base(r) and not r["stopped"]]
    return {"title": "Spurious motion of drops at rest", "drops": rows}


def picture(data: Mapping[str, Any]) -> Any:
    """One mark a drop, larger for larger drops; 2D full, 3D open."""
    figure, grid = plt.subplots(2, 3, figsize=(12.0, 7.6), sharey=True)
    place = {name: -k for k, name in enumerate(MODELS)}
    for axes, (name, label, limits) in zip(grid.flat, SHOWN):
        for d in data["drops"]:
            if d[name] is None:
                continue
            colour, full = COLOURS[d["model"]], d["dim"] == 2
            face = colour if full else "white"
            y = place[d["model"]] + (0.15 if full else -0.15)
            axes.plot(d[name], y, "o", ms=3 + 0.2 * d["radius"], color=colour, mfc=face, alpha=0.85)
        if name != "nn_5":
            axes.set_xscale("log")
        if limits is not None:
            axes.set_xlim(*limits)
        axes.set_xlabel(label)
        axes.grid(True, axis="x", which="major")
        for model, y in place.items():
            if not any(d["model"] == model for d in data["drops"]):
                axes.text(
                    0.5, y, "no drop lasted", transform=axes.get_yaxis_transform(), fontsize=8, color=GREY, va="center"
                )
    for line in grid:
        line[0].set_yticks(list(place.values()), [MODELS[name][0] for name in place])
        line[0].set_ylim(-len(place) + 0.4, 0.6)
    figure.suptitle(
        "Drops at rest, Oh = 0.03, h = 2.6 d (IISPH 2 d), S = 0.01: full marks 2D, open ones 3D, by size of the drop",
        fontsize=10.5,
    )
    return figure
