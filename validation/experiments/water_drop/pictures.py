"""Jump and oscillation of the water drops against what the requested tension gives."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLUE, GREY, VERMILION
from validation.experiment import Picture, Results

COLOURS = {"wendland": BLUE, "mueller": VERMILION}


def data(results: Results) -> dict[str, Any]:
    """The series of every drop that lasted."""
    names = ("kernels", "dim", "seed", "asked", "radius", "laplace", "rayleigh", "asked_frequency", "uncertainty")
    drops = [
        {n: r.values[n] for n in names} | {n: [float(f"{v:.5g}") for v in values] for n, values in r.arrays.items()}
        for r in results.values()
        if not r.values["stopped"]
    ]
    return {"title": "A millimetre of water, coefficients from calibrate", "drops": drops}


def picture(data: Mapping[str, Any]) -> Any:
    """Left: the jump over the time; middle: the mode n = 2; right: both tensions in mN/m. Bands: 5 % about 72.8."""
    figure, (jump, swing, both) = plt.subplots(1, 3, figsize=(12.0, 4.0), width_ratios=(1, 1.2, 1))
    if not data["drops"]:
        return figure
    first = data["drops"][0]
    asked = (first["dim"] - 1) * first["asked"] / np.mean([d["radius"] for d in data["drops"]])
    jump.axhspan(0.95 * asked, 1.05 * asked, color="#dddddd", lw=0)
    jump.axhline(asked, color=GREY, lw=0.9)
    seen: set[str] = set()
    for d in data["drops"]:
        colour, label = COLOURS[d["kernels"]], None if d["kernels"] in seen else d["kernels"]
        seen.add(d["kernels"])
        jump.plot(1e3 * np.array(d["jump_time"]), d["jump"], lw=0.8, color=colour, label=label)
        swing.plot(1e3 * np.array(d["moment_time"]), d["moment"], lw=1.0, color=colour)
        place = {"wendland": 0, "mueller": 1}[d["kernels"]]
        shift = 0.06 * (d["seed"] - 5)
        for x, name, face in ((place - 0.15, "laplace", colour), (place + 0.15, "rayleigh", "white")):
            both.errorbar(
                x + shift, 1e3 * d[name], 1e3 * d["asked"] * d["uncertainty"], fmt="o" if face == colour else "s", ms=6,
                color=colour, mfc=face, capsize=2, lw=1.0,
            )  # fmt: skip
    period = 1e3 / first["asked_frequency"]
    for k in range(3):
        swing.axvline((k + 0.25) * period, color=GREY, lw=0.8, ls=":")
        swing.axvline((k + 0.75) * period, color=GREY, lw=0.8, ls=":")
    swing.set_xlim(0, max(1e3 * d["moment_time"][-1] for d in data["drops"]))
    both.axhspan(0.95e3 * first["asked"], 1.05e3 * first["asked"], color="#dddddd", lw=0)
    both.axhline(1e3 * first["asked"], color=GREY, lw=0.9)
    both.set_xticks([0, 1], ["wendland", "mueller"])
    both.set_xlim(-0.5, 1.5)
    span = max(0.1, *(1.2 * abs(d[n] / d["asked"] - 1) for d in data["drops"] for n in ("laplace", "rayleigh")))
    both.set_ylim(1e3 * first["asked"] * (1 - span), 1e3 * first["asked"] * (1 + span))
    jump.set(ylim=(0, 1.4 * asked), xlabel="time [ms]", ylabel="pressure jump [Pa]")
    jump.set_title(f"at rest; line: {first['dim'] - 1} sigma/R", fontsize=9.5)
    swing.set(xlabel="time [ms]", ylabel="second moment of the mode n = 2")
    swing.set_title("kicked; dotted: extremes at Rayleigh's frequency", fontsize=9.5)
    both.set_ylabel("tension [mN/m]")
    both.set_title("Laplace full, Rayleigh open", fontsize=9.5)
    for axes in (jump, swing, both):
        axes.grid(True, axis="y")
    jump.legend(fontsize=8, loc="lower right")
    figure.suptitle(f"{data['title']}; grey: 5 % about the requested tension; bars: calibrate's +-", fontsize=10.5)
    return figure


PICTURES = (Picture("water_drop", data, picture),)
