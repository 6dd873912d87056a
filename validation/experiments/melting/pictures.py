"""Pictures of melting, each drawn from its own data file."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from numpy.typing import NDArray

from refsim.render.space import Body
from refsim.render.surfaces import surface_around
from validation import drawing
from validation.drawing import GREY, packed, unpacked
from validation.experiment import Picture, Results
from validation.experiments.melting.runs import ON_GPU, PAPER, TITLES, grouped
from validation.experiments.melting.scene import SPACING
from validation.results import real

WATER = (0.30, 0.58, 0.86)
BODY = {
    "red": (0.80, 0.16, 0.14), "green": (0.16, 0.60, 0.26), "blue": (0.15, 0.33, 0.78), "yellow": (0.93, 0.74, 0.12),
}  # fmt: skip
ICE = (0.86, 0.93, 0.98)
PIXELS = 480


def stage_data(key: str, title: str) -> Any:
    """Frames of a figure's run, as a picture's data."""

    def collect(results: Results) -> dict[str, Any]:
        result = results[key]
        values, arrays = result.values, result.arrays
        frames = [
            {
                "time": at, "position_cm": packed(arrays[f"position_{k}"]),
                "temperature": packed(arrays[f"temperature_{k}"]), "solid": packed(arrays[f"solid_{k}"]),
                "share": float(arrays[f"solid_{k}"].sum() / sum(values["solids"])),
            }
            for k, at in enumerate(values["times"])
        ]  # fmt: skip
        kept = ("figure", "particles", "solids", "tank", "colours", "densities", "temperatures", "bookkeeping")
        return {"title": title, **{name: values[name] for name in kept}, "frames": frames}

    return collect


def body_of(points: NDArray, colour: tuple[float, ...], **look: Any) -> Body:
    """The surface around particles [m], lit."""
    return Body(*surface_around(points, SPACING), colour, **look)


def stage_picture(azimuth: float, elevation: float, melt_shown: bool) -> Any:
    """Above the lit surfaces of water, melt and solids; below the temperature of the particles, cut in the middle."""

    def draw(data: Mapping[str, Any]) -> Any:
        frames, tank = data["frames"], np.array(data["tank"], dtype=float)
        view = drawing.view_matrix(azimuth, elevation)
        middle = tank * (0.5, 0.5, 0.36)
        corners = (np.array(list(np.ndindex(2, 2, 2))) * tank - middle) @ view.T
        extent = 1.04 * np.abs(corners[:, :2]).max()
        owner = np.repeat(np.arange(len(data["solids"])), data["solids"])
        part = np.append(owner, np.full(data["particles"] - len(owner), -1))
        cold, hot = data["temperatures"]
        norm, colours = Normalize(cold, hot), plt.get_cmap("RdYlBu_r")
        loaded = []
        for f in frames:
            x = unpacked(f["position_cm"], "int16", 3) / 100.0 - middle
            loaded.append((x, unpacked(f["temperature"], "uint8") / 2.0 - 25, unpacked(f["solid"], "uint8") > 0))
        top = max(float((x @ view.T)[:, 1].max()) for x, _, _ in loaded) + 2 * SPACING
        low, wide, columns = float(corners[:, 1].min()), float(np.abs(corners[:, 0]).max()), len(frames)
        ratio = (top - low) / (2 * wide)
        figure, panels = plt.subplots(2, columns, figsize=(11.0, 1.0 + 2 * ratio * 11.0 / columns), squeeze=False)
        for axes, below, f, (x, temperature, solid) in zip(*panels, frames, loaded):
            layers = []
            for body, colour in enumerate(data["colours"]):
                shade = BODY[colour] if melt_shown else ICE
                layers.append(body_of(x[(part == body) & solid], shade))
                if melt_shown:
                    paler = tuple(0.45 + 0.55 * c for c in shade)
                    layers.append(body_of(x[(part == body) & ~solid], paler))
            water = (part < 0) if melt_shown else ~solid
            layers.append(body_of(x[water], WATER, water=True))
            edges(axes, corners, False)
            axes.imshow(drawing.body_picture(layers, view, extent, PIXELS), extent=(-extent, extent) * 2, zorder=2)
            edges(axes, corners, True)
            drawing.plain_title(axes, f"{f['time']:.2f} s, {100 * f['share']:.0f} % solid")
            shown = x[:, 1] >= 0 if abs(azimuth + 90) < 45 else x[:, 1] >= -1e9
            shade = colours(norm(temperature[shown]))[:, :3]
            picture = drawing.ball_picture(x[shown], 0.55 * SPACING, shade, view, extent, PIXELS)
            edges(below, corners, False)
            below.imshow(picture, extent=(-extent, extent) * 2, zorder=2)
            for each in (axes, below):
                each.set(xlim=(-wide - SPACING, wide + SPACING), ylim=(low - SPACING, top))
                each.set_axis_off()
        figure.colorbar(
            ScalarMappable(norm, colours), ax=panels[1, :].tolist(), location="bottom", fraction=0.07, pad=0.02,
            aspect=60, label="temperature of the particles [deg C]; the front half is cut away",
        )  # fmt: skip
        solids = f"{sum(data['solids']):,} solid at the start"
        drawing.headline(figure, f"{data['title']}: {data['particles']:,} particles, {solids}")
        return figure

    return draw


def edges(axes: Any, corners: NDArray, front: bool) -> None:
    """Edges of the tank, the hind ones behind the picture."""
    farthest = int(np.argmin(corners[:, 2]))
    for a in range(8):
        for bit in (1, 2, 4):
            b = a ^ bit
            if a < b and (farthest in (a, b)) != front and not (front and max(a, b) and (a & 1) and (b & 1)):
                axes.plot(*corners[[a, b], :2].T, color=GREY, linewidth=0.6, alpha=0.8, zorder=3 if front else 1)


def filling_data(results: Results) -> dict[str, Any]:
    """Figure 3: the plate, its node, and arrayR after each pass."""
    result = results["filling"]
    return {
        "title": "Figure 3: arrayR of one node, filled level by level",
        **{name: result.values[name] for name in ("node", "cell", "half_width")},
        "cells": result.arrays["cells"].tolist(), "solid": result.arrays["solid"].tolist(),
        "passes": result.arrays["passes"].tolist(),
    }  # fmt: skip


def filling_picture(data: Mapping[str, Any]) -> Any:
    """The plate with its nodes' numbers, then the middle layer of arrayR after each pass; -1 stands for none."""
    passes, node, width = data["passes"], data["node"], data["half_width"]
    shares = (1.5, *(1.0 for _ in passes))
    figure, panels = plt.subplots(1, len(passes) + 1, figsize=(10.0, 3.3), width_ratios=shares)
    plate = panels[0]
    a0, b0, _ = data["cell"]

    def cell(axes: Any, a: int, b: int, colour: str, words: str, size: float, known: bool) -> None:
        look = {"facecolor": colour, "edgecolor": "#999999", "linewidth": 0.8}
        axes.add_patch(plt.Rectangle((a - 0.5, b - 0.5), 1, 1, **look))
        axes.text(a, b, words, ha="center", va="center", fontsize=size, color="black" if known else GREY)

    for s, ((a, b, _), solid) in enumerate(zip(data["cells"], data["solid"])):
        held = abs(a - a0) <= width and abs(b - b0) <= width
        colour = "white" if not solid else "#FDBE6F" if s == node else "#CFE3F5" if held else "#EEEEEE"
        cell(plate, a, b, colour, str(s) if solid else "melted", 8 if solid else 7, solid)
    corner, side = (a0 - width - 0.5, b0 - width - 0.5), 2 * width + 1
    plate.add_patch(plt.Rectangle(corner, side, side, fill=False, linewidth=1.6))
    plate.set(xlim=(-0.6, 6.6), ylim=(-0.6, 6.6))
    drawing.plain_title(plate, f"the plate; box of node {node}, w = {width}")
    before = [[-1] * len(passes[0])] * len(passes[0])
    for k, (axes, now) in enumerate(zip(panels[1:], passes)):
        for i, j in np.ndindex(len(now), len(now[0])):
            entry = now[i][j]
            colour = "white" if entry < 0 else "#FDBE6F" if before[i][j] < 0 else "#CFE3F5"
            cell(axes, i, j, colour, str(entry), 9, entry >= 0)
        axes.set(xlim=(-0.6, len(now) - 0.4), ylim=(-0.6, len(now) - 0.4))
        drawing.plain_title(axes, f"after pass {k}")
        before = now
    for axes in panels:
        axes.set_aspect("equal")
        axes.set_axis_off()
    drawing.headline(figure, data["title"])
    return figure


COLOURS = {
    "neighbour list": "#8DA0CB", "liquid and coupling": "#4A90C2", "heat": "#D9653B", "melting": "#E9C46A",
    "shape matching": "#5AAE7A",
}  # fmt: skip


def time_data(results: Results) -> dict[str, Any]:
    """Table 2 and figure 7: milliseconds a step, stage by stage."""
    rows = []
    for figure, (label, paper) in PAPER.items():
        values = results[f"cost_{figure}"].values
        rows.append({
            "figure": figure, "words": label, "paper": paper, "liquid": values["liquid"], "solid": values["solid"],
            "milliseconds": 1e3 * values["seconds"], "threads": values["threads"],
            "stages": {name: 1e3 * s for name, s in grouped(values["stages"]).items()},
        })  # fmt: skip
    return {"title": "Table 2 and figure 7: a step of 5 ms", "rows": rows}


def time_picture(data: Mapping[str, Any]) -> Any:
    """A bar for each scene, cut into stages, and the paper's number beside it."""
    rows = data["rows"]
    figure, axes = plt.subplots(figsize=(9.6, 0.9 + 0.55 * len(rows)))
    labels = []
    ends = drawing.stacked_bars(axes, [row["stages"] for row in rows], COLOURS)
    for k, (row, left) in enumerate(zip(rows, ends)):
        axes.text(left, k, f"  {left:.0f} ms", va="center", fontsize=8.5)
        axes.plot([row["paper"]] * 2, [k - 0.42, k + 0.42], color="black", linewidth=2)
        labels.append(f"{row['liquid'] / 1e3:.1f}k + {row['solid'] / 1e3:.1f}k")
    axes.plot([], [], color="black", linewidth=2, label="paper, GTX 690")
    axes.set_yticks(range(len(rows)), labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(f"milliseconds a step, CPU, {rows[0]['threads']} threads")
    axes.grid(axis="x")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.24), ncols=6)
    axes.set_title(data["title"])
    return figure


def gpu_data(results: Results) -> dict[str, Any]:
    """Table 2 and a million particles on a GPU: milliseconds a step, stage by stage."""
    rows = []
    for figure in ON_GPU:
        values = results[f"gpu_{figure}"].values
        rows.append({
            "figure": figure, "liquid": values["liquid"], "solid": values["solid"],
            "paper": PAPER[figure][1] if figure in PAPER else None, "renewed": values["renewed"],
            "stages": {name: 1e3 * s for name, s in values["stages"].items()},
            "operations": {name: 1e3 * s for name, s in values["operations"].items()},
            **{name: 1e3 * real(values[name]) for name in ("seconds", "one_graph", "with_list")},
        })  # fmt: skip
    machine = results[f"gpu_{ON_GPU[0]}"].about["machine"]
    return {"title": "Table 2 on a GPU, and a million particles", "machine": machine, "rows": rows}


def gpu_picture(data: Mapping[str, Any]) -> Any:
    """A bar for each scene, cut into stages; the mean step, lists included, and the paper's number beside it."""
    groups = [[row for row in data["rows"] if row["paper"]], [row for row in data["rows"] if not row["paper"]]]
    figure, panels = plt.subplots(2, 1, figsize=(9.6, 4.0), height_ratios=[len(rows) for rows in groups])
    for axes, rows in zip(panels, groups):
        ends = drawing.stacked_bars(axes, [row["stages"] for row in rows], COLOURS)
        for k, (row, left) in enumerate(zip(rows, ends)):
            axes.plot([row["seconds"]] * 2, [k - 0.42, k + 0.42], color="black", linewidth=2)
            label = f"  {row['seconds']:.2f} ms a step" + (f", paper {row['paper']:g}" if row["paper"] else "")
            axes.text(max(left, row["seconds"]), k, label, va="center", fontsize=8.5)
        labels = [f"{row['liquid'] / 1e3:.1f}k + {row['solid'] / 1e3:.1f}k" for row in rows]
        axes.set_yticks(range(len(rows)), labels, fontsize=8)
        axes.set_xlim(0, 1.35 * max(max(sum(row["stages"].values()), row["seconds"]) for row in rows))
        axes.invert_yaxis()
        axes.grid(axis="x")
    panels[0].plot([], [], color="black", linewidth=2, label="mean step, lists included")
    panels[0].set_title(data["title"])
    panels[1].set_xlabel(f"milliseconds, {data['machine'].get('gpu', 'GPU')}; each stage by itself")
    drawing.shared_legend(figure, panels[:1], ncols=6, fontsize=8)
    return figure


VIEWS = {"figure_4": (-68.0, 16.0, False), "figure_5": (-68.0, 22.0, True), "figure_6": (-72.0, 24.0, True)}
PICTURES = (
    Picture("melting_figure_3", filling_data, filling_picture, ("filling",)),
    *(Picture(f"melting_{key}", stage_data(key, TITLES[key]), stage_picture(*view), (key,), shaded=True)
      for key, view in VIEWS.items()),
    Picture("melting_figure_7", time_data, time_picture, tuple(f"cost_{name}" for name in PAPER)),
    Picture("melting_gpu", gpu_data, gpu_picture, tuple(f"gpu_{figure}" for figure in ON_GPU)),
)  # fmt: skip
