"""Spurious speed and capillary number of drops at rest."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.cases.laplace.pictures import COLOURS
from validation.drawing import GREY
from validation.drops import MODELS
from validation.harness import Results
from validation.sigma_map import at_base

SHOWN = (("spurious", "rms speed over sqrt(sigma/(rho R))"), ("capillary", "capillary number mu max|v|/sigma"))


def data(results: Results) -> dict[str, Any]:
    """Every drop at the map's base."""
    names = ("model", "dim", "radius", "seed", "spurious", "capillary")
    rows = [{n: r[n] for n in names} for r in results["map"].values["rows"] if at_base(r) and not r["stopped"]]
    return {"title": "Spurious motion of drops at rest", "drops": rows}


def picture(data: Mapping[str, Any]) -> Any:
    """One mark a drop, larger for larger drops; 2D full, 3D open."""
    import matplotlib.pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(10.0, 4.0), sharey=True)
    place = {name: -k for k, name in enumerate(MODELS)}
    for axes, (name, label) in zip(panels, SHOWN):
        for d in data["drops"]:
            colour, full = COLOURS[d["model"]], d["dim"] == 2
            face = colour if full else "white"
            y = place[d["model"]] + (0.15 if full else -0.15)
            axes.plot(d[name], y, "o", ms=3 + 0.2 * d["radius"], color=colour, mfc=face, alpha=0.85)
        axes.set_xscale("log")
        axes.set_xlabel(label)
        axes.grid(True, axis="x", which="major")
        for model, y in place.items():
            if not any(d["model"] == model for d in data["drops"]):
                axes.text(
                    0.5, y, "no drop lasted", transform=axes.get_yaxis_transform(), fontsize=8, color=GREY, va="center"
                )
    panels[0].set_yticks(list(place.values()), [MODELS[name][0] for name in place])
    panels[0].set_ylim(-len(place) + 0.4, 0.6)
    panels[0].set_title("Drops at rest, Oh = 0.03: 2D full, 3D open")
    return figure
