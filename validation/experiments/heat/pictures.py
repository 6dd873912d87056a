"""Pictures of heat conduction, each drawn from its data file alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, shared_legend
from validation.experiment import Picture, Results
from validation.experiments.heat import runs
from validation.experiments.heat.runs import BEST
from validation.metrics import heat as exact
from validation.metrics.heat import SCHEMES
from validation.results import floats

COLOURS = {
    "one_sided": VERMILION, "pair_exchange": ORANGE, "implicit": BLUE,
    "conjugate_gradient": PURPLE, "runge_kutta_legendre": GREEN, "explicit": GREY,
}  # fmt: skip
EXACT = {"color": BLACK, "linestyle": "--", "linewidth": 1.1}


def _found(results: Results, prefix: str) -> dict[str, Any]:
    """Rows of each scheme that was run."""
    return {name: results[f"{prefix}{name}"].values["rows"] for name in SCHEMES if f"{prefix}{name}" in results}


def schemes_data(results: Results) -> dict[str, Any]:
    """Error against passes."""
    return {"title": "A cosine in a slab: error against work", "schemes": _found(results, "slab_")}


def schemes(data: Mapping[str, Any]) -> Any:
    """Error over the passes for each unit of k dt/(rho c d^2); crosses at the top edge have blown up."""
    figure, axis = plt.subplots(figsize=(7.6, 4.2))
    for name, rows in data["schemes"].items():
        colour = COLOURS[name]
        shown = [(r["work"], r["error"], r["number"]) for r in rows if r["work"] and r["error"]]
        if shown:
            work, error, _ = zip(*shown)
            axis.loglog(work, error, "o-", color=colour, label=SCHEMES[name])
            for w, e, n in shown:
                axis.annotate(f"{n:g}", (w, e), (4, 4), textcoords="offset points", fontsize=7, color=colour)
        lost = [r["work"] for r in rows if r["work"] and not r["error"]]
        axis.plot(lost, [60.0] * len(lost), "x", color=colour, label=f"{SCHEMES[name]}: blown up" if lost else None)
    axis.set(xlabel="passes over the neighbours for each k dt/(rho c d²) = 1", ylabel="rms error [% of the range]")
    axis.set(title=data["title"])
    axis.grid(True, which="major")
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def _curve(x: np.ndarray, y: np.ndarray, digits: int = 4) -> dict[str, Any]:
    return {"x": np.round(x, digits), "y": np.round(y, digits)}


def _curves(results: Results, kind: str, schemes: Iterable[str], x: str, y: str, digits: int = 4) -> dict[str, Any]:
    """A curve of two arrays for each scheme that was run."""
    found = {name: results[f"{kind}_{name}"].arrays for name in schemes if f"{kind}_{name}" in results}
    return {name: _curve(arrays[x], arrays[y], digits) for name, arrays in found.items()}


def profiles_data(results: Results) -> dict[str, Any]:
    """Slab, sphere and column at the end, with the exact curves."""
    depth = (np.arange(runs.LENGTH) + 0.5) * runs.SPACING
    found = {name: results[f"slab_{name}"].arrays["profile_8"] for name in SCHEMES if f"slab_{name}" in results}
    slab = {name: _curve(depth, profile) for name, profile in found.items() if np.abs(profile).max() < 1e3}
    ball = results["sphere_runge_kutta_legendre"]
    some = np.random.default_rng(0).permutation(len(ball.arrays["r"]))[:600]
    sphere = {}
    for name in ("implicit", "runge_kutta_legendre"):
        if f"sphere_{name}" in results:
            arrays = results[f"sphere_{name}"].arrays
            sphere[name] = _curve(arrays["r"][some], arrays["temperature_2"][some])
    radius = np.linspace(0, 1, 101)
    column = results["stefan_runge_kutta_legendre"].values
    ice = _curves(results, "stefan", ("runge_kutta_legendre", "implicit"), "x", "temperature_2")
    x = np.linspace(0, 1, 201)
    truth = exact.stefan_profile(x, column["until"], runs.WALL, runs.START, column["root"])
    return {
        "title": "Profiles beside the exact ones",
        "slab": {"curves": slab, "exact": _curve(depth, exact.cosine(depth, runs.LENGTH * runs.SPACING, runs.END))},
        "sphere": {"curves": sphere, "exact": _curve(radius, exact.cooled_sphere(radius, 1.05, 0.1))},
        "stefan": {"curves": ice, "exact": _curve(x - column["rows"][1]["size"] / 2, truth)},
    }


def profiles(data: Mapping[str, Any]) -> Any:
    """Three panels: slab, sphere, Stefan's problem."""
    figure, panels = plt.subplots(1, 3, figsize=(12.5, 3.6))
    words = {
        "slab": ("A cosine in a slab, k dt/(rho c d²) = 8", "depth [m]", "-"),
        "sphere": ("A jittered sphere that cools, k dt/(rho c d²) = 2", "radius [m]", "."),
        "stefan": ("Ice beside a warm wall, k dt/(rho c d²) = 2", "depth [m]", "-"),
    }
    for axis, (key, (title, label, mark)) in zip(panels, words.items()):
        for name, curve in data[key]["curves"].items():
            size = {"markersize": 2.5} if mark == "." else {"linewidth": 1.5}
            axis.plot(floats(curve["x"]), floats(curve["y"]), mark, color=COLOURS[name], label=SCHEMES[name], **size)
        axis.plot(floats(data[key]["exact"]["x"]), floats(data[key]["exact"]["y"]), label="exact", **EXACT)
        axis.set(title=title, xlabel=label)
        axis.grid()
    panels[0].set_ylabel("temperature [°C]")
    panels[2].set_xlim(-0.08, 0.8)
    shared_legend(figure, panels, ncols=4)
    return figure


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


PICTURES = (
    Picture("heat_schemes", schemes_data, schemes, ("slab_implicit", f"slab_{BEST}")),
    Picture("heat_profiles", profiles_data, profiles,
            ("slab_one_sided", "slab_runge_kutta_legendre", f"sphere_{BEST}", f"stefan_{BEST}", "stefan_implicit")),
    Picture("heat_fronts", fronts_data, fronts, (f"stefan_{BEST}", f"melting_{BEST}_20", "oracle")),
)  # fmt: skip
