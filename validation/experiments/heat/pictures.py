"""Pictures of heat conduction, each drawn from its data file alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from validation.experiment import Picture, Results
from validation.experiments.heat.runs import BEST
from validation.metrics.heat import SCHEMES
from validation.results import floats

COLOURS = {
    "one_sided": VERMILION, "pair_exchange": ORANGE, "implicit": BLUE,
    "conjugate_gradient": PURPLE, "runge_kutta_legendre": GREEN, "explicit": GREY,
}  # fmt: skip
EXACT = {"color": BLACK, "linestyle": "--", "linewidth": 1.1}


def _curve(x: np.ndarray, y: np.ndarray, digits: int = 4) -> dict[str, Any]:
    return {"x": np.round(x, digits), "y": np.round(y, digits)}


def _curves(results: Results, kind: str, schemes: Iterable[str], x: str, y: str, digits: int = 4) -> dict[str, Any]:
    """A curve of two arrays for each scheme that was run."""
    found = {name: results[f"{kind}_{name}"].arrays for name in schemes if f"{kind}_{name}" in results}
    return {name: _curve(arrays[x], arrays[y], digits) for name, arrays in found.items()}


def fronts_data(results: Results) -> dict[str, Any]:
    """Melted depth and radius of the ice over time, with both readings of where the wall stands."""
    column = results["stefan_runge_kutta_legendre"]
    spacing = column.values["rows"][1]["size"]
    time = column.arrays["time_2"]
    depth = _curves(results, "stefan", SCHEMES, "time_8", "depth_8", 5)
    truth = 2 * column.values["root"] * np.sqrt(np.linspace(0, time[-1], 101))
    ball = results["melting_runge_kutta_legendre_20"]
    oracle = results["oracle"]
    inside = slice(None, None, max(1, len(oracle.arrays["time"]) // 200))
    spheres = _curves(results, "melting_runge_kutta_legendre", ("10", "20"), "time", "radius", 5)
    return {
        "title": "Fronts of melting ice", "depth": depth, "raw": _curve(np.linspace(0, time[-1], 101), truth, 5),
        "shifted": _curve(np.linspace(0, time[-1], 101), truth - spacing / 2, 5), "spheres": spheres,
        "sphere": _curve(oracle.arrays["time"][inside], np.cbrt(oracle.arrays["ice"][inside]), 5),
        "sphere_shifted": _curve(ball.arrays["time"], ball.arrays["shifted"], 5),
    }  # fmt: skip


def fronts(data: Mapping[str, Any]) -> Any:
    """Two panels: melted depth beside a wall, radius of a sphere of ice."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 3.8))
    for name, curve in data["depth"].items():
        wide = 3.2 if name == "implicit" else 1.5  # conjugate gradients solve the same, and lie on it
        left.plot(floats(curve["x"]), floats(curve["y"]), color=COLOURS[name], label=SCHEMES[name], linewidth=wide)
    left.plot(floats(data["raw"]["x"]), floats(data["raw"]["y"]), label="exact, wall at the surface", **EXACT)
    shifted = {**EXACT, "linestyle": ":"}
    x, y = (floats(data["shifted"][name]) for name in "xy")
    left.plot(x, y, label="exact, wall at the first held layer", **shifted)
    left.set_ylim(bottom=0)
    left.set_title("Melted depth [m], k dt/(rho c d²) = 8")
    for (cells, curve), colour in zip(data["spheres"].items(), (SKY, GREEN)):
        right.plot(
            floats(curve["x"]), floats(curve["y"]), color=colour, label=f"particles, R = {cells} d", linewidth=1.5
        )
    right.plot(floats(data["sphere"]["x"]), floats(data["sphere"]["y"]), label="1D, wall at R", **EXACT)
    x, y = (floats(data["sphere_shifted"][name]) for name in "xy")
    right.plot(x, y, label="1D, wall at R + d/2, 20 d", **shifted)
    right.set(title="Radius of a sphere of ice [m]", ylim=(0, 1.02))
    for axis in (left, right):
        axis.set_xlabel("time [s]")
        axis.set_xlim(left=0)
        axis.grid()
    left.legend(fontsize=7.5, loc="center right", bbox_to_anchor=(-0.12, 0.5))
    right.legend(fontsize=7.5)
    return figure


PICTURES = (Picture("heat_fronts", fronts_data, fronts, (f"stefan_{BEST}", f"melting_{BEST}_20", "oracle")),)
