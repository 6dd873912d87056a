"""Pictures of the dam break, each drawn from its own data file."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.lines import Line2D

from validation.drawing import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    INTERIOR_BLUE,
    ORANGE,
    SKY,
    SURFACE_RED,
    VERMILION,
    shared_legend,
)
from validation.experiment import Picture, Results
from validation.experiments.dam_break.runs import FIGURE_5, METHODS, WORDS
from validation.metrics.dam_break import data_tolerance, load_front_data, ritter_front
from validation.results import floats

SHOWN_AT, SHOWN_UP_TO = 1.6, 0.85  # s, m: the wave that came back from the wall breaks; spray above is left out
LOOKS = {"number_density": ("o", ORANGE), "fan_scan": ("^", GREEN), "two_step": ("s", BLUE)}
TITLES = {
    "number_density": "a  Number density, J(12)", "fan_scan": "b  Fan scan, J(13)",
    "two_step": "c  Two-step: sparse or lopsided, J(13)",
}  # fmt: skip


def detection_data(results: Results) -> dict[str, Any]:
    """Figure 4: one moment, each detector's flags, and the truth."""
    values, arrays = results["detection_2d"].values, results["detection_2d"].arrays
    time = floats(values["time"])
    k = int(np.argmin(np.abs(time - SHOWN_AT)))
    data = {
        "title": "Figure 4: free-surface particles found in a dam break", "time_s": float(time[k]),
        "shown_up_to_m": SHOWN_UP_TO, "spacing_m": values["spacing"], "truth_radius_spacings": values["truth_radius"],
        "position_m": np.round(arrays["position"][k][:, :2].astype(float), 4), "truth": arrays["truth"][k].astype(int),
    }  # fmt: skip
    for method in METHODS:
        data[method] = arrays[method][k].astype(int)
        data[f"{method}_score"] = {n: values["over_time"][method][n][k] for n in ("precision", "recall", "f1")}
    return data


def detection_picture(data: Mapping[str, Any]) -> Any:
    """Three panels: surface red, interior blue, errors against the exact truth ringed."""
    position, truth = np.array(data["position_m"]), np.array(data["truth"], bool)
    top = data["shown_up_to_m"]
    above = int((position[:, 1] > top).sum())
    figure, panels = plt.subplots(3, 1, figsize=(8.0, 3 * (7.2 * top / 2.04 + 0.4) + 0.8), sharex=True)
    size = (72 * 7.6 / 2.06 * data["spacing_m"]) ** 2
    for axes, method in zip(panels, METHODS):
        flags, score = np.array(data[method], bool), data[f"{method}_score"]
        missed, extra = truth & ~flags, flags & ~truth
        axes.scatter(*position[~flags].T, s=0.55 * size, c=INTERIOR_BLUE, lw=0)
        axes.scatter(*position[flags].T, s=0.55 * size, c=SURFACE_RED, lw=0)
        axes.scatter(*position[extra].T, s=2.4 * size, facecolors="none", edgecolors=BLACK, lw=0.9, marker="s")
        axes.scatter(*position[missed].T, s=2.8 * size, facecolors="none", edgecolors=BLACK, lw=0.9)
        axes.plot([0, 0, 2, 2], [top, 0, 0, top], color=GREY, lw=1.2)
        axes.set_title(TITLES[method])
        title = f"precision {score['precision']:.2f}   recall {score['recall']:.2f}   F1 {score['f1']:.2f}"
        axes.set_title(title, loc="right", fontweight="normal", fontsize=9.5)
        axes.set(xlim=(-0.02, 2.02), ylim=(-0.02, top), aspect="equal", ylabel="y [m]")
    panels[-1].set_xlabel("x [m]")

    hollow = {"markerfacecolor": "none", "markeredgecolor": BLACK, "markersize": 7}
    marks = (
        ("taken for surface", {"marker": "o", "color": SURFACE_RED}),
        ("taken for interior", {"marker": "o", "color": INTERIOR_BLUE}),
        ("wrong: is interior", {"marker": "s", **hollow}), ("wrong: is surface", {"marker": "o", **hollow}),
    )  # fmt: skip
    title = f"t = {data['time_s']:.2f} s, {len(position):,} particles ({above} of the spray are above the picture)"
    truth_words = f"truth: exact arc cover, radius {data['truth_radius_spacings']:g} spacings"
    dots = {label: Line2D([], [], ls="", **look) for label, look in marks}
    shared_legend(figure, (), dots, ncols=4, title=f"{title}; {truth_words}", title_fontsize=9)
    return figure


def cost_data(results: Results) -> dict[str, Any]:
    """Figure 5: detection time against particle number."""
    costs = [result for key, result in results.items() if key.startswith("detection_cost_")]
    costs.sort(key=lambda result: result.values["particles"])
    return {
        "title": "Figure 5: detection time in a dam break", "moment_s": costs[0].values["moment"],
        "machine": costs[-1].about["machine"], "date": costs[-1].about["date"],
        "moved_on": costs[-1].values["moved_on"], "sizes": [result.values for result in costs],
    }  # fmt: skip


def cost_picture(data: Mapping[str, Any]) -> Any:
    """Time of three detectors, and what two steps take of the fan scan's; bars are the scatter of the readings."""
    sizes = data["sizes"]
    number = np.array([size["particles"] for size in sizes])

    def milliseconds(method: str, part: str) -> np.ndarray:
        return 1e3 * np.array([size["methods"][method][part] for size in sizes])

    figure, (whole, ratio) = plt.subplots(1, 2, figsize=(9.2, 4.2))
    for method in ("fan_scan", "two_step", "number_density"):
        time, bar = milliseconds(method, "whole"), milliseconds(method, "spread")
        mark, colour = LOOKS[method]
        whole.errorbar(number, time, bar, label=WORDS[method], color=colour, marker=mark, ms=5, capsize=3)
    whole.set(title="Detection in all particles", yscale="log", ylabel="time [ms]")
    low, high = whole.get_ylim()
    whole.set_ylim(min(low, 10.0 ** np.floor(np.log10(low * 1.01))), 2.5 * high)
    shares = {}
    for part, colour, line, label in (
        ("charged", SKY, "D--", "both with the pass of J(7) and J(8)"),
        ("whole", BLUE, "s-", "both without it: the liquid has computed it"),
    ):
        scan = milliseconds("fan_scan", part)
        shares[part] = share = milliseconds("two_step", part) / scan
        relative = milliseconds("two_step", "spread") / milliseconds("two_step", part)
        bar = share * np.hypot(relative, milliseconds("fan_scan", "spread") / scan)
        ratio.errorbar(number, 100 * share, 100 * bar, fmt=line, color=colour, ms=5, capsize=3, label=label)
    ratio.axhline(50, color=GREY, lw=1, ls=":")
    ratio.set(title="Two steps over the fan scan", ylabel="share of time [%]", ylim=(0, 130))
    for axes in (whole, ratio):
        axes.set_xscale("log")
        axes.set_xticks(number, [f"{n / 1000:.3g}" for n in number])
        axes.xaxis.set_minor_locator(plt.NullLocator())
        axes.set_xlabel("thousands of particles")
        axes.grid(True)
        axes.legend(loc="upper left")
    whole.yaxis.set(major_formatter="{x:g}", minor_formatter=plt.NullFormatter())
    least, most = 100 * shares["charged"].min(), 100 * shares["charged"].max()
    took = f"{least:.0f} to {most:.0f} % of the fan scan's time"
    figure.suptitle(f"Detection in two steps takes {took}, J(8) counted in both", fontweight="bold")
    where = f"{data['machine']['processor']}, {data['machine']['cores']} cores"
    figure.supxlabel(f"2D, t = {data['moment_s']:g} s, one thread; {where}", fontsize=8, color=GREY)
    return figure


def front_data(results: Results) -> dict[str, Any]:
    """Surge front of the runs, and each series' fitted offset."""
    names = ("particles", "time", "connected", "farthest", "front")
    fronts = {key[-2:].upper(): results[key].values for key in ("front_2d", "front_3d") if key in results}
    runs = {label: {name: values[name] for name in names} for label, values in fronts.items()}
    return {"title": "Surge front of a collapsing column", "tolerance": data_tolerance(), "runs": runs}


def front_picture(data: Mapping[str, Any]) -> Any:
    """Front against time with the experiments, and the deviation from each."""
    figure, (axes, below) = plt.subplots(2, 1, figsize=(7.4, 6.4), sharex=True, height_ratios=(2.1, 1))
    run = data["runs"]["2D"]
    time, front = np.array(run["time"]), np.array(run["connected"])
    looks = {
        "martin_moyce_1.125in": ("o", BLUE, "Martin & Moyce 1952, 1.125 in"),
        "martin_moyce_2.25in": ("s", SKY, "Martin & Moyce 1952, 2.25 in"),
        "koshizuka_oka": ("^", GREEN, "Koshizuka & Oka 1996"),
        "koshizuka_oka_mps": ("x", GREY, "Koshizuka & Oka 1996, computed (MPS)"),
    }
    axes.plot(time, front, color=VERMILION, label=f"refsim 2D, {run['particles']:,} particles", zorder=3)
    if "3D" in data["runs"]:
        other = data["runs"]["3D"]
        words = f"refsim 3D, {other['particles']:,} particles"
        axes.plot(other["time"], other["connected"], color=BLACK, ls="--", lw=1.4, zorder=3, label=words)
    late = time <= 2.2
    axes.plot(time[late], ritter_front(time[late]), color=GREY, lw=1, ls=":", label="Ritter's bound, 1 + 2 T")
    for name, (mark, colour, words) in looks.items():
        series, fit = load_front_data(name), run["front"][name]
        filled = {} if mark == "x" else {"markerfacecolor": "white", "markeredgewidth": 1.4}
        label = f"{words}, offset {fit['offset']:+.2f}"
        at = series.time + fit["offset"]
        axes.plot(at, series.front, mark, color=colour, ms=6, label=label, **filled)
        within = at <= time[-1]
        deviation = 100 * (np.interp(at[within], time, front) / series.front[within] - 1)
        below.plot(at[within], deviation, mark, color=colour, ms=6, **filled)
    bar = 100 * data["tolerance"]
    below.axhspan(-bar, bar, color=BLUE, alpha=0.10, lw=0)
    below.text(0.02, bar - 0.6, f"the experiments differ by up to {bar:.1f} %", fontsize=8, color=GREY, va="top")
    below.axhline(0, color=GREY, lw=0.8)
    reach = max(1.5 * bar, 1.0)
    below.set(ylim=(-reach, reach), xlabel=r"$T = t\,\sqrt{2g/L}$ (experiments shifted by their fitted offset)")
    below.set(ylabel="2D run from series [%]")
    axes.set(ylabel="front position z / L", title="Surge front of a column L wide and 2 L high", xlim=(0, time[-1]))
    axes.set_ylim(bottom=0.5)
    axes.legend(loc="upper left")
    for each in (axes, below):
        each.grid(True)
    return figure


PICTURES = (
    Picture("figure_4", detection_data, detection_picture, ("detection_2d",)),
    Picture("figure_5", cost_data, cost_picture, FIGURE_5),
    Picture("front", front_data, front_picture, ("front_2d",)),
)
