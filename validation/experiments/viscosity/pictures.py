"""Angular momentum of spinning drops, and the rates of braking and damping over the radius."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLUE, GREY, VERMILION
from validation.experiment import Picture, Results

COLOURS = {"laplacian": VERMILION, "central": BLUE}
WORDS = {"laplacian": "J(11)", "central": "central"}


def data(results: Results) -> dict[str, Any]:
    """The series of every drop that spins, and its rates."""
    drops = []
    for result in results.values():
        rates = {n: v for n, v in result.values.items() if n.startswith(("braking", "damping"))}
        series = {n: [float(f"{v:.6g}") for v in values] for n, values in result.arrays.items()}
        drops.append({n: result.values[n] for n in ("dim", "radius", "size")} | rates | series)
    return {"title": "Viscosity of free drops, h = 2.6 d", "drops": drops}


def picture(data: Mapping[str, Any]) -> Any:
    """Left: angular momentum of the largest drops; right: rates over 5 nu/R^2 (4 nu/R^2 in 2D) by radius."""
    figure, (spin, rates) = plt.subplots(1, 2, figsize=(10.0, 4.2))
    for dim, style in ((2, "--"), (3, "-")):
        own = sorted((d for d in data["drops"] if d["dim"] == dim), key=lambda d: d["radius"])
        if not own:
            continue
        for form, colour in COLOURS.items():
            largest = own[-1]
            label = f"{WORDS[form]}, {dim}D, R = {largest['radius']:g} d"
            spin.plot(largest[f"time.{form}"], largest[f"left.{form}"], style, color=colour, label=label)
            radius = [d["size"] for d in own]
            damping = [d[f"damping.{form}"] for d in own]
            rates.plot(radius, damping, style, marker="o", color=colour, label=f"damping, {WORDS[form]}, {dim}D")
        braking = [d["braking.laplacian"] for d in own]
        rates.plot([d["size"] for d in own], braking, style, marker="s", mfc="white", color=GREY,
                   label=f"braking, J(11), {dim}D")  # fmt: skip
    time = np.linspace(0, 1.5, 60)
    spin.plot(time, np.exp(-time), ":", color=GREY, label="exp(-t)")
    rates.axhline(1.0, color=GREY, lw=0.8, ls=":")
    rates.axhline(0.5, color=GREY, lw=0.8, ls=":")
    spin.set(xlabel="time times 5 nu/R^2 (4 nu/R^2 in 2D)", ylabel="angular momentum over that at the start")
    spin.set(ylim=(0, 1.05))
    rates.set(xscale="log", ylim=(0, 1.2), xlabel="radius [d]", ylabel="rate over 5 nu/R^2 (4 nu/R^2 in 2D)")
    rates.set_xticks([5, 10, 20, 30], ["5", "10", "20", "30"])
    rates.minorticks_off()
    for axes in (spin, rates):
        axes.grid(True)
        axes.legend(fontsize=7, handlelength=4)
    figure.suptitle(data["title"], fontsize=10.5)
    return figure


PICTURES = (Picture("viscosity", data, picture),)
