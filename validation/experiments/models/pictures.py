"""Pictures of the models, each drawn from its own data file."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from refsim import Akinci2013, BeckerTeschner2007, Dong2016, JiangZhu2023, TartakovskyMeakin2005, WeaklyCompressible
from refsim.core.effect import Discretisation
from refsim.surface_tension.dong_2016.reference import force_function
from validation.drawing import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    VERMILION,
    WATER,
    caption,
    show_balls,
    thousandths,
    view_matrix,
)
from validation.experiment import Picture, Results
from validation.experiments.models.scene import MODELS
from validation.results import real

VIEW = view_matrix(azimuth=32.0, elevation=24.0)
EXTENT = 1.5  # half width of a frame, in R
THROWN = 0.3  # radius variation beyond which particles have left the drop
SUPPORT = 2.6  # of the curves, in spacings
CURVES = {
    "Jiang & Zhu 2023": (JiangZhu2023, BLUE), "Akinci 2013": (Akinci2013, VERMILION), "Dong 2016": (Dong2016, GREEN),
    "Tartakovsky & Meakin 2005": (TartakovskyMeakin2005, PURPLE),
    "Becker & Teschner 2007": (BeckerTeschner2007, ORANGE),
}  # fmt: skip


def curve_data(results: Results) -> dict[str, Any]:
    """Figure 3: force of a pair of particles against their distance, all models at the same nominal tension."""
    grid = Discretisation(3, "float64", 1.0, SUPPORT, 1)
    fluid = WeaklyCompressible(rest_density=1.0, sound_speed=100.0, density="summation")
    others = {fluid.name: fluid}
    mass = fluid.particle_mass(grid)
    r = np.linspace(0, SUPPORT, 261)
    curves = {}
    for name, (model, _) in CURVES.items():
        force = model(surface_tension=1.0).pair_force(np.minimum(r, SUPPORT * (1 - 1e-12)), grid, others)  # type: ignore
        curves[name] = (mass**2 * force).round(5)
    return {
        "title": "Figure 3: force of a pair, all models at the same nominal tension",
        "distance_supports": (r / SUPPORT).round(5), "force_over_sigma_d": curves, "support_spacings": SUPPORT,
    }  # fmt: skip


def curve_picture(data: Mapping[str, Any]) -> Any:
    """Draw figure 3."""
    figure, axes = plt.subplots(figsize=(6.6, 4.2))
    for name, values in data["force_over_sigma_d"].items():
        axes.plot(data["distance_supports"], values, label=name, color=CURVES[name][1])
    axes.axhline(0, color=GREY, linewidth=0.8)
    axes.axvline(1 / data["support_spacings"], color=GREY, linewidth=0.8, linestyle=":")
    axes.annotate("one spacing", (1 / data["support_spacings"], 1.62), xytext=(4, 0), textcoords="offset points",
                  color=GREY, fontsize=8)  # fmt: skip
    axes.set(xlim=(0, 1), ylim=(-1.05, 1.8), xlabel="r/h", ylabel=r"force/($\sigma d$), repulsion upwards")
    axes.set_title(data["title"])
    axes.legend(loc="upper right")
    axes.grid(True)
    return figure


def dong_data(results: Results) -> dict[str, Any]:
    """Dong's figure 1: L(r)/k for three supports."""
    r = np.linspace(0, 2.5, 251)
    return {
        "title": "Dong, figure 1: L(r) for three supports", "distance_rest_distances": r.round(4),
        "force_over_k": {
            f"{h:g}": force_function(np.maximum(h - r, 0), h, 1.0).round(6) for h in (1.5, 2.0, 2.5)
        },
    }  # fmt: skip


def dong_picture(data: Mapping[str, Any]) -> Any:
    """Draw Dong's figure 1, and its attractive part enlarged."""
    figure, pair = plt.subplots(1, 2, figsize=(8.2, 3.6))
    for colour, (ratio, values) in zip((BLUE, GREEN, VERMILION), data["force_over_k"].items()):
        for axes in pair:
            axes.plot(data["distance_rest_distances"], values, color=colour, label=f"h = {ratio} d0")
    pair[0].set(xlabel="r/d0", ylabel="L/k, repulsion upwards", ylim=(-0.1, 1.05))
    pair[1].set(xlabel="r/d0", ylim=(-0.06, 0.01), xlim=(0.9, 2.5))
    pair[0].set_title(data["title"])
    pair[1].set_title("its attraction")
    for axes in pair:
        axes.axhline(0, color=GREY, linewidth=0.8)
        axes.grid(True)
    pair[1].legend(loc="lower right")
    return figure


def panel_data(results: Results) -> dict[str, Any]:
    """Figure 6 for all models: the particles that can be seen soon after the start, at a quarter and at the end."""
    rows = []
    for name, model in MODELS.items():
        if f"cube_{name}" not in results:
            continue
        result = results[f"cube_{name}"]
        values, position = result.values, result.arrays["position"]
        last = len(position) - 1
        frames = []
        for k in sorted({min(4, last), last // 4, last}):
            x = position[k].astype(float)
            x = (x - np.median(x, axis=0)) / values["radius"]
            frames.append({
                "time_s": values["series"]["time"][k],
                "radius_variation": real(values["series"]["radius_variation"][k]),
                "position_milliradii": thousandths(x),
            })  # fmt: skip
        rows.append(
            {"model": model.words, "stopped": values["stopped"],
             "spacing_radii": values["spacing"] / values["radius"], "frames": frames}
        )  # fmt: skip
    count = result.values["particles"]
    title = f"Figure 6: the same cube of {count:,} under all models"
    return {"title": title, "half_width_radii": EXTENT, "rows": rows}


def panel_picture(data: Mapping[str, Any]) -> Any:
    """Draw the panel, a model a column."""
    rows, half = data["rows"], data["half_width_radii"]
    figure, axes = plt.subplots(3, len(rows), figsize=(1.75 * len(rows), 5.9), squeeze=False)
    for place in axes.flat:
        place.set_axis_off()
    for column, row in zip(axes.T, rows):
        for place, frame in zip(column, row["frames"]):
            x = np.array(frame["position_milliradii"], dtype=float) / 1000
            show_balls(place, x, row["spacing_radii"], WATER, VIEW, half, 300)
            variation = frame["radius_variation"]
            label = "thrown apart" if variation is None or variation > THROWN else f"{variation:.4f}"
            caption(place, f"{frame['time_s']:.2f} s, {label}", fontsize=7.5, color="#444444")
        title = row["model"].replace(" & ", " &\n").replace("] ", "]\n")
        column[0].set_title(title, fontsize=8, loc="center")
    figure.suptitle(data["title"] + " (time, radius variation)", fontsize=10.5, fontweight="bold")
    return figure


SHAPES = {"cube": "lattice cube", "cut": "cut cube"}


def rest_data(results: Results) -> dict[str, Any]:
    """Table 1: seconds until each model's drop is at rest, from both cubes, beside the paper's."""
    rows = []
    for name, model in MODELS.items():
        row: dict[str, Any] = {"model": model.words, "paper_s": model.paper}
        for shape in SHAPES:
            values = results[f"{shape}_{name}"].values
            rest, end = values["rest"], values["end"]
            row[shape] = {
                "particles": values["particles"], "seconds": None if rest is None else rest["wall"],
                "steps": None if rest is None else rest["steps"], "time_s": None if rest is None else rest["time"],
                "radius_variation": end["radius_variation"], "nn_5_spacings": end["nn_5"],
                "seconds_per_step": real(values["series"]["wall"][-1]) / max(1, values["series"]["steps"][-1]),
                "area_over_ball": values["surface"]["end"]["area"], "kinetic_share": end["kinetic_share"],
                "stopped": values["stopped"],
            }  # fmt: skip
        rows.append(row)
    about = results[f"cube_{next(iter(MODELS))}"].about
    return {
        "title": "Table 1: seconds until at rest",
        "criterion": "kinetic energy below 1e-3 of its peak from then on, within 2.2 s of simulated time",
        "machine": about.get("machine"), "date": about.get("date"), "threads": about.get("threads"), "rows": rows,
    }  # fmt: skip


QUALITIES = (
    ("seconds_per_step", "cost", "milliseconds a step", 1e3),
    ("radius_variation", "roughness", "radius variation", 1.0),
    ("nn_5_spacings", "clustering", "nearest neighbour, 5 % [d]", 1.0),
)  # fmt: skip


def rest_picture(data: Mapping[str, Any]) -> Any:
    """Draw table 1: bars of the paper and of both cubes, and what the drops are like at the end."""
    rows = data["rows"]
    figure, axes = plt.subplots(1, 4, figsize=(11.0, 5.4), sharey=True, width_ratios=(2.2, 1, 1, 1.3))
    at = np.arange(len(rows))[::-1]
    longest = max([row[s]["seconds"] or 0 for row in rows for s in SHAPES] + [row["paper_s"] or 0 for row in rows])
    bars = [("paper", 0.27, GREY), *zip(SHAPES, (0.0, -0.27), (BLUE, GREEN))]
    for key, shift, colour in bars:
        seconds = [row["paper_s"] if key == "paper" else row[key]["seconds"] for row in rows]
        count = "" if key == "paper" else f" of {rows[0][key]['particles']:,}"
        label = "paper (another machine)" if key == "paper" else SHAPES[key] + count
        axes[0].barh(at + shift, [s or 0 for s in seconds], 0.25, color=colour, label=label)
        for y, value, row in zip(at + shift, seconds, rows):
            missing = "not in the paper" if key == "paper" else (row[key]["stopped"] and "stopped") or "never at rest"
            words = missing if value is None else f"{value:.1f}"
            axes[0].text((value or 0) + 0.01 * longest, y, words, va="center", fontsize=7, color=colour)
    axes[0].set_yticks(at, [row["model"] for row in rows])
    axes[0].set(xlabel="seconds until at rest", xlim=(0, 1.14 * longest), title=data["title"])
    axes[0].legend(loc="lower right")
    for place, (key, title, words, unit) in zip(axes[1:], QUALITIES):
        for shape, shift, colour in bars[1:]:  # type: ignore[misc]
            place.barh(at + shift, [unit * real(row[shape].get(key)) for row in rows], 0.25, color=colour)
        place.set(xlabel=words, title=title)
        if key == "radius_variation":
            place.set(xscale="log", xlim=(1e-3, 10.0))
    for place in axes:
        place.grid(True, axis="x")
    return figure


PICTURES = (
    Picture("figure_3_force_curves", curve_data, curve_picture),
    Picture("dong_figure_1", dong_data, dong_picture),
    Picture("models_panel", panel_data, panel_picture, tuple(f"cube_{m}" for m in MODELS), shaded=True),
    Picture("models_table_1", rest_data, rest_picture, tuple(f"{shape}_{m}" for shape in SHAPES for m in MODELS)),
)
