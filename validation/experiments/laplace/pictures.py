"""Pictures of the pressure jump and of the sigma map."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from refsim.surface_tension.calibration import BASE
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, shared_legend
from validation.experiment import Picture, Results
from validation.experiments.laplace.runs import setting_words
from validation.measure.drops import FITTED_FROM, MODELS, SEEDED, base
from validation.measure.sigma_map import at_base
from validation.results import real

COLOURS = dict(zip(MODELS, (BLACK, VERMILION, ORANGE, BLUE, SKY, GREEN, PURPLE, GREY, "#8c6d31", "#bbbbbb", "#d62fae")))
STYLES = {name: "--" if name.endswith(("cohesion", "soft")) else "-" for name in MODELS}


RING = {"marker": "o", "ms": 8, "mfc": "none", "mec": "black", "mew": 1.0, "ls": "none"}  # of what is measured now


def jump_data(results: Results) -> dict[str, Any]:
    """Jump of each drop at the map's base, the fits, and the drops measured now."""
    values = results["map"].values
    names = ("model", "dim", "effective_radius", "pressure", "seed")
    drops = [{n: row[n] for n in names} for row in values["rows"] if at_base(row) and not row["stopped"]]
    fits = [
        {n: entry[n] for n in ("model", "dim", "laplace", "laplace_error", "intercept")}
        for entry in values["settings"]
        if at_base(entry) and math.isfinite(real(entry["laplace"]))
    ]
    rows = [result.values for key, result in results.items() if key != "map"]
    now = [{n: row[n] for n in names} for row in rows if not row["stopped"]]
    return {"title": "Pressure jump of drops at rest", "drops": drops, "fits": fits, "now": now}


def jump_picture(data: Mapping[str, Any]) -> Any:
    """R jump/(dim - 1) against R, which is level if drops have a surface tension."""
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 5.0))
    for dim, axes in zip((2, 3), panels):
        least = FITTED_FROM * BASE["support"]  # smaller drops are not judged: the surface reaches all of them
        for model, colour in COLOURS.items():
            own = [d for d in data["drops"] if d["model"] == model and d["dim"] == dim and d["pressure"] > 0]
            if own:
                radius, tension = _by_radius(own, dim)
                look = {"marker": "o", "ms": 4, "lw": 1.4, "color": colour, "label": MODELS[model][0]}
                axes.plot(radius, tension, STYLES[model], **look)
        now = [d for d in data.get("now", ()) if d["dim"] == dim]
        if now:
            axes.plot(*_by_radius(now, dim), label="Akinci 2013, measured again", **RING)
        axes.axvspan(0, least, color="#eeeeee", lw=0)
        axes.text(least - 0.1, 0.15, "R < 3 h", ha="right", color=GREY, fontsize=8)
        axes.axhline(1, color=GREY, lw=0.8, ls=":")
        axes.set(xlim=(4.5, 26 if dim == 2 else 15), ylim=(0, 6.2), title=f"{dim}D, h = 2.6 d (IISPH 2 d), S = 0.01")
        axes.set(xlabel="radius R [d]", ylabel=f"{'R' if dim == 2 else 'R/2'} times jump, over the nominal tension")
        axes.grid(True)
    shared_legend(figure, panels, ncols=4, fontsize=8)
    figure.suptitle("A drop's pressure jump is that of a surface tension where the line is level", fontweight="bold")
    return figure


def _by_radius(drops: list[dict[str, Any]], dim: int) -> tuple[list[float], list[float]]:
    """Radii, rounded to spacings, and the mean tension R jump/(dim - 1) of the drops of each."""
    found: dict[int, list[tuple[float, float]]] = {}
    for d in drops:
        tension = d["effective_radius"] * d["pressure"] / (dim - 1)
        found.setdefault(round(d["effective_radius"]), []).append((d["effective_radius"], tension))
    means = [[sum(column) / len(rows) for column in zip(*rows)] for _, rows in sorted(found.items())]
    return [m[0] for m in means], [m[1] for m in means]


def map_data(results: Results) -> dict[str, Any]:
    """The map's settings."""
    return {"title": "Measured over nominal surface tension", "settings": results["map"].values["settings"]}


def map_picture(data: Mapping[str, Any]) -> Any:
    """Jump and frequency of each model's drops at the base, joined by a line."""
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 4.6), sharey=True)
    span: list[float] = []
    for axes, dim in zip(panels, (2, 3)):
        own = [e for e in data["settings"] if e["dim"] == dim and at_base(e)]
        found = _models(axes, own)
        span += found if dim == 3 else []
        axes.set(title=f"{dim}D, R = {SEEDED[dim]:g} d, h = 2.6 d, S = 0.01", xlabel="measured over nominal tension")
    panels[1].tick_params(labelleft=False)
    handles, words = panels[1].get_legend_handles_labels()
    figure.legend(handles, words, loc="outside lower center", ncols=2)
    if span:
        times = f"{min(span):.1f} to {max(span):.1f} times the nominal one"
        figure.suptitle(f"3D: two measures of surface tension differ, and are {times}", fontweight="bold")
    return figure


def at_radius(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The drops of the radius at which several seeds are measured."""
    found = [d for d in entry["drops_by_radius"] if d["radius"] == SEEDED[entry["dim"]]]
    return found[0] if found else None


MEASURES = (
    ("laplace", "by the pressure jump", "o", BLUE),
    ("rayleigh", "by the frequency of its swing", "s", VERMILION),
)
LARGEST = 10.0  # times the nominal tension that a panel shows


def _models(axes: Any, entries: list[dict[str, Any]]) -> list[float]:
    """Draw both measures of each model; returns their values."""
    place = {name: -k for k, name in enumerate(MODELS)}
    label = {name: words for name, words, *_ in MEASURES}
    seen: list[float] = []
    for e in entries:
        y, drops = place[e["model"]], at_radius(e)
        if drops is None:
            reasons = ", ".join(e["stopped"]) or "no frequency"
            axes.text(LARGEST - 0.2, y, reasons, ha="right", va="center", fontsize=7.5, color=GREY)
            continue
        ends = [drops[name] for name, *_ in MEASURES]
        seen += ends
        axes.plot([min(end, LARGEST) for end in ends], [y, y], color="#bbbbbb", lw=2.2, zorder=1)
        for (name, _, marker, colour), value in zip(MEASURES, ends):
            if value > LARGEST:
                axes.text(LARGEST - 0.2, y + 0.12, f"{value:.0f} \u2192", ha="right", fontsize=7.5, color=colour)
                continue
            bar, words = drops[f"{name}_spread"] or 0.0, label.pop(name, None)
            axes.errorbar(value, y, xerr=bar, fmt=marker, ms=6, color=colour, capsize=2, lw=1.2, label=words, zorder=2)
    axes.axvline(1, color=GREY, lw=0.8, ls=":")
    own = {
        name: "" if base(name)["support"] == BASE["support"] else f", h = {base(name)['support']:g} d" for name in place
    }
    axes.set_yticks(list(place.values()), [MODELS[name][0] + own[name] for name in place])
    axes.set(xlim=(0, LARGEST), ylim=(-len(place) + 0.4, 0.6))
    axes.grid(True, axis="x")
    return seen


PICTURES = (
    Picture("laplace", jump_data, jump_picture, ("map",)),
    Picture("sigma_map", map_data, map_picture, ("map",)),
)


# Contact angle against the coefficient of adhesion.


WETTING_COLOURS = (BLACK, BLUE, SKY, VERMILION, ORANGE, PURPLE)


def wetting_at_base(entry: Mapping[str, Any]) -> bool:
    """Whether the map's axes cross at this setting."""
    return all(entry[name] == value for name, value in BASE.items())


def wetting_data(results: Results) -> dict[str, Any]:
    """The map."""
    title = "Contact angle of sessile drops, Akinci 2013 (triangles: up, leaves the plane; down, a film)"
    return {"title": title, "settings": results["map"].values["settings"]}


def wetting_picture(data: Mapping[str, Any]) -> Any:
    """The angle against beta/gamma at the base, and its cosine along the axes."""
    figure, panels = plt.subplots(1, 3, figsize=(11.0, 3.9))
    for dim, colour in ((2, BLUE), (3, VERMILION)):
        for entry in (e for e in data["settings"] if e["dim"] == dim and wetting_at_base(e)):
            _line(panels[0], entry, colour, f"{dim}D", angle=True)
    panels[0].set(ylim=(0, 180), yticks=range(0, 181, 30), ylabel="contact angle [degrees]")
    panels[0].set(title="h = 2.6 d, S = 0.01, mueller")
    for axes, dim in zip(panels[1:], (2, 3)):
        entries = sorted((e for e in data["settings"] if e["dim"] == dim), key=lambda e: not wetting_at_base(e))
        for entry, colour in zip(entries, WETTING_COLOURS):
            if any(drop["angle"] is not None for drop in entry["drops"]):
                _line(axes, entry, colour, setting_words(entry).partition(", ")[2], angle=False)
        axes.axhline(0, color=GREY, lw=0.8, ls=":")
        axes.set(ylim=(-1.05, 1.4), ylabel="cosine of the contact angle", title=f"{dim}D")
    for axes in panels:
        axes.set_xlabel("adhesion over cohesion, beta/gamma")
        axes.grid(True)
        axes.legend(loc="upper right" if axes is panels[0] else "upper left", fontsize=7.5, ncols=1)
    figure.suptitle(data["title"], fontsize=11)
    return figure


def _line(axes: Any, entry: Mapping[str, Any], colour: str, label: str, angle: bool) -> None:
    caps = [drop for drop in entry["drops"] if drop["angle"] is not None]
    share = [drop["share"] for drop in caps]
    values = np.array([drop["angle"] for drop in caps])
    spread = np.array([real(drop["spread"]) for drop in caps])
    shown, bars = values, np.nan_to_num(spread)
    if not angle:
        shown, bars = np.cos(np.radians(values)), np.nan_to_num(spread) * np.pi / 180 * np.sin(np.radians(values))
    axes.errorbar(share, shown, bars, fmt="-o", ms=4.5, lw=1.2, capsize=2, color=colour, label=label)
    if angle:
        circle = [real(drop["circle"]) for drop in caps]
        axes.plot(share, circle, "o", ms=4.5, color=colour, mfc="white", label=f"{label}, by the circle")
        for drop in entry["drops"]:
            for fate, mark, y in (("film", "v", 3), ("detached", "^", 177)):
                if drop["angle"] is None and fate in drop["fates"]:
                    axes.plot(drop["share"], y, mark, ms=6, color=colour)


WETTING_PICTURES = (Picture("wetting", wetting_data, wetting_picture, ("map",)),)
