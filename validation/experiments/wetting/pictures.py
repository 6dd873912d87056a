"""Contact angle against the coefficient of adhesion, and the outlines of drops."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from refsim.surface_tension.calibration import BASE
from validation.drawing import BLACK, BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION
from validation.experiment import Results
from validation.measure.wetting import cap_volume
from validation.results import real

COLOURS = (BLACK, BLUE, SKY, VERMILION, ORANGE, PURPLE)


def words_of(entry: Mapping[str, Any]) -> str:
    """A setting in words."""
    return f"{entry['dim']}D, h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}"


def name_of(entry: Mapping[str, Any]) -> str:
    """A setting as a part of a measurement's name."""
    return f"{entry['dim']}d_{entry['kernels']}_h{entry['support']:g}_S{entry['stiffness']:g}"


def at_base(entry: Mapping[str, Any]) -> bool:
    """Whether the map's axes cross at this setting."""
    return all(entry[name] == value for name, value in BASE.items())


def data(results: Results) -> dict[str, Any]:
    """The map, and the outlines of the drops that were measured now."""
    drawn = [
        {name: result.values[name] for name in ("dim", "asked", "angle", "circle", "particles", "density", "profile")}
        for key, result in results.items()
        if key != "map" and not result.values["stopped"]
    ]
    drawn.sort(key=lambda drop: (drop["dim"], drop["asked"]))
    return {
        "title": "Contact angle of sessile drops, Akinci 2013 (triangles: up, leaves the plane; down, a film)",
        "settings": results["map"].values["settings"],
        "drops": drawn,
    }


def picture(data: Mapping[str, Any]) -> Any:
    """Above: the angle against beta/gamma at the base, and its cosine along the axes; below: outlines of drops."""
    drops = data["drops"]
    figure = plt.figure(figsize=(11.0, 7.0 if drops else 3.9))
    above, below = figure.subfigures(2, 1, height_ratios=(1.35, 1)) if drops else (figure, None)
    panels = above.subplots(1, 3)
    for dim, colour in ((2, BLUE), (3, VERMILION)):
        for entry in (e for e in data["settings"] if e["dim"] == dim and at_base(e)):
            _line(panels[0], entry, colour, f"{dim}D", angle=True)
    panels[0].set(ylim=(0, 180), yticks=range(0, 181, 30), ylabel="contact angle [degrees]")
    panels[0].set(title="h = 2.6 d, S = 0.01, mueller")
    for axes, dim in zip(panels[1:], (2, 3)):
        entries = sorted((e for e in data["settings"] if e["dim"] == dim), key=lambda e: not at_base(e))
        for entry, colour in zip(entries, COLOURS):
            if any(drop["angle"] is not None for drop in entry["drops"]):
                _line(axes, entry, colour, words_of(entry).partition(", ")[2], angle=False)
        axes.axhline(0, color=GREY, lw=0.8, ls=":")
        axes.set(ylim=(-1.05, 1.4), ylabel="cosine of the contact angle", title=f"{dim}D")
    for axes in panels:
        axes.set_xlabel("adhesion over cohesion, beta/gamma")
        axes.grid(True)
        axes.legend(loc="upper right" if axes is panels[0] else "upper left", fontsize=7.5, ncols=1)
    if below is not None:
        for axes, drop in zip(np.atleast_1d(below.subplots(1, len(drops))), drops):
            _outline(axes, drop)
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


def _outline(axes: Any, drop: Mapping[str, Any]) -> None:
    """Mean radii of the slices, and the cap with the drop's volume and the angle that was read."""
    radius = np.array(drop["profile"])
    z = np.arange(len(radius)) + 0.5
    axes.plot(np.concatenate([-radius, radius]), np.concatenate([z, z]), "o", ms=3.5, color=BLUE, label="slices")
    for angle, colour, style, label in (
        (drop["angle"], VERMILION, "-", "cap"),
        (drop["asked"], GREEN, "--", "requested"),
    ):
        turn = math.radians(angle)
        size = (drop["particles"] / drop["density"] / cap_volume(turn, drop["dim"])) ** (1 / drop["dim"])
        along = np.linspace(-turn, turn, 200)
        axes.plot(
            size * np.sin(along), size * (np.cos(along) - math.cos(turn)), style, lw=1.2, color=colour, label=label
        )
    axes.axhline(0, color=BLACK, lw=1.5)
    axes.set_aspect("equal")
    axes.set_title(f"{drop['dim']}D: {drop['angle']:.0f} of {drop['asked']:.0f} degrees", fontsize=9)
    axes.set_xlabel("[d]")
    axes.legend(loc="lower center", fontsize=7)
