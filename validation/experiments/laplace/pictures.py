"""Pictures of the pressure jump and of the sigma map."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from refsim.surface_tension.calibration import BASE
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from validation.experiment import Picture, Results
from validation.experiments.laplace.runs import setting_words
from validation.measure.drops import MODELS, SEEDED, base
from validation.measure.sigma_map import at_base
from validation.results import real


def map_data(results: Results) -> dict[str, Any]:
    """The map's settings."""
    return {"title": "Measured over nominal surface tension", "settings": results["map"].values["settings"]}


def map_picture(data: Mapping[str, Any]) -> Any:
    """Jump and frequency of each model's drops at the base, joined by a line."""
    figure, panels = plt.subplots(1, 2, figsize=(9.6, 4.6), sharey=True)
    span: list[float] = []
    for axes, dim in zip(panels, (2, 3)):
        settings = [e for e in data["settings"] if e["dim"] == dim and at_base(e)]
        models = _models(axes, settings)
        span += models if dim == 3 else []
        axes.set(title=f"{dim}D, R = {SEEDED[dim]:g} d, h = 2.6 d, S = 0.01", xlabel="measured over nominal tension")
    panels[1].tick_params(labelleft=False)
    handles, names = panels[1].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2)
    if span:
        times = f"{min(span):.1f} to {max(span):.1f} times the nominal one"
        figure.suptitle(f"3D: two measures of surface tension differ, and are {times}", fontweight="bold")
    return figure


def at_radius(entry: Mapping[str, Any]) -> Mapping[str, Any] | None:
    """The drops of the radius at which several seeds are measured."""
    seeded = [d for d in entry["drops_by_radius"] if d["radius"] == SEEDED[entry["dim"]]]
    return seeded[0] if seeded else None


MEASURES = (
    ("laplace", "by the pressure jump", "o", BLUE),
    ("rayleigh", "by the frequency of its swing", "s", VERMILION),
)
LARGEST = 10.0  # times the nominal tension that a panel shows


def _models(axes: Any, entries: list[dict[str, Any]]) -> list[float]:
    """Draw both measures of each model; returns their values."""
    place = {name: -k for k, name in enumerate(MODELS)}
    label = {name: title for name, title, *_ in MEASURES}
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
            bar, title = drops[f"{name}_spread"] or 0.0, label.pop(name, None)
            axes.errorbar(value, y, xerr=bar, fmt=marker, ms=6, color=colour, capsize=2, lw=1.2, label=title, zorder=2)
    axes.axvline(1, color=GREY, lw=0.8, ls=":")
    models = {
        name: "" if base(name)["support"] == BASE["support"] else f", h = {base(name)['support']:g} d" for name in place
    }
    axes.set_yticks(list(place.values()), [MODELS[name][0] + models[name] for name in place])
    axes.set(xlim=(0, LARGEST), ylim=(-len(place) + 0.4, 0.6))
    axes.grid(True, axis="x")
    return seen


PICTURES = (Picture("sigma_map", map_data, map_picture, ("map",)),)


# Contact angle against the coefficient of adhesion.


WETTING_COLOURS = (BLACK, BLUE, SKY, VERMILION, ORANGE, PURPLE, GREEN)


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
        axes.set(ylim=(-1.05, 2.0), ylabel="cosine of the contact angle", title=f"{dim}D")
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
