"""Pictures of the reconstruction, each drawn from its own data file."""

import itertools
import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

from validation.checks import number
from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION
from validation.experiment import Picture, Results
from validation.experiments.surface_reconstruction.scene import RADII
from validation.results import floats

SHOWN = {
    "gradient_0.25_1": ("best: gradient, $\\epsilon$ = h/4, 1 sweep", BLUE),
    "mls_0.5_10": ("default: MLS, $\\epsilon$ = h/2, 10 sweeps", GREEN),
    "facets": ("marching-cubes facets", ORANGE),
    "offsets": ("away from the nearest particle", VERMILION),
}
BINS = np.linspace(0, 40, 81)


def error_data(results: Results) -> dict[str, Any]:
    """Histograms of the angle between normals and the true ones, for the settings that are shown."""
    shapes = {}
    for shape in RADII:
        arrays, rows = results[f"normals_{shape}"].arrays, results[f"normals_{shape}"].values["rows"]
        shapes[shape] = {
            key: {"share": np.histogram(np.minimum(arrays[key], 39.9), BINS)[0] / len(arrays[key]),
                  "mean": rows[key]["mean"], "max": rows[key]["max"]}
            for key in SHOWN
        }  # fmt: skip
    title = "Error of normals on a particle cloud of radius 9 h"
    return {"title": title, "bins_degrees": BINS, "shapes": shapes}


def error_picture(data: Mapping[str, Any]) -> Any:
    """One panel a shape, one curve a setting."""
    bins = floats(data["bins_degrees"])
    figure, panels = plt.subplots(1, len(data["shapes"]), figsize=(9.0, 3.4), sharey=True)
    for axes, (shape, curves) in zip(panels, data["shapes"].items()):
        for key, (words, colour) in SHOWN.items():
            curve = curves[key]
            label = f"{words}\nmean {curve['mean']:.1f}, largest {curve['max']:.0f} degrees"
            axes.stairs(100 * floats(curve["share"]), bins, color=colour, linewidth=1.6, label=label)
        axes.set(title=shape.capitalize(), xlabel="angle to the true normal [degrees]; last bin: all beyond")
        axes.set(xlim=(0, 40))
        axes.grid(axis="y")
        axes.legend(loc="upper right", fontsize=7.5)
    panels[0].set_ylabel("share of samples [%]")
    return figure


BOXES = (
    ("cells", "particles\nby cell"), ("level set and facets", "level set,\nmarching cubes"), ("samples", "samples"),
    ("offsets", "nearest particles,\noffsets"), ("fit", "spline fit\n(LSPIA)"), ("normals", "normals"),
    ("inset", "inset, samples\nanew"), ("components", "components\nunder tension"),
    ("force", "force on\nthe nodes"),
)  # fmt: skip


def pipeline_data(results: Results) -> dict[str, Any]:
    """Seconds of each stage, for the largest number of particles."""
    values = results["stages"].values
    rows = [row for row in values["rows"] if row["quadrature"] == "facets"]
    row = max(rows, key=lambda r: r["particles"])
    return {"title": "Figure 4.7: from particles to force", "backend": values["backend"], **row}


def pipeline_picture(data: Mapping[str, Any], columns: int = 5) -> Any:
    """The stages as boxes, row by row, to the right and back again, joined by arrows, with milliseconds and shares."""
    total, rows = sum(data["stages"].values()), math.ceil(len(BOXES) / columns)
    figure, axes = plt.subplots(figsize=(10.0, 0.6 + 1.2 * rows))
    axes.set(xlim=(-0.1, columns + 0.1), ylim=(0.2, 1.15 * rows - 0.15))
    axes.set_axis_off()
    centres = []
    for k in range(len(BOXES)):
        row, at = divmod(k, columns)
        centres.append((at + 0.5 if row % 2 == 0 else columns - 0.5 - at, 0.6 + 1.15 * (rows - 1 - row)))
    for (name, label), (x, y) in zip(BOXES, centres):
        seconds = data["stages"].get(name, 0.0)
        share = seconds / total
        box = FancyBboxPatch(
            (x - 0.4, y - 0.3), 0.8, 0.6, boxstyle="round,pad=0.02,rounding_size=0.06", linewidth=1.0,
            edgecolor="#444444", facecolor=plt.get_cmap("Blues")(0.08 + 0.6 * share),
        )  # fmt: skip
        axes.add_patch(box)
        axes.text(x, y + 0.1, label, ha="center", va="center", fontsize=8.5)
        spent = f"{number(float(f'{1e3 * seconds:.3g}'))} ms, {100 * share:.0f} %"
        axes.text(x, y - 0.2, spent, ha="center", va="center", fontsize=8, color=GREY)
    for (x0, y0), (x1, y1) in itertools.pairwise(centres):
        if y0 == y1:
            sign = 1 if x1 > x0 else -1
            ends = (x0 + 0.43 * sign, y0), (x1 - 0.43 * sign, y1)
        else:
            ends = (x0, y0 - 0.33), (x1, y1 + 0.33)
        axes.add_patch(FancyArrowPatch(*ends, arrowstyle="-|>", mutation_scale=11, color="#444444", linewidth=1.1))
    counts = f"{data['particles']:,} particles, {data['samples']:,} samples"
    axes.set_title(f"{data['title']}: {counts}, {data['backend']}, {1e3 * total:.3g} ms in all")
    return figure


PICTURES = (
    Picture("surface_normals", error_data, error_picture, ("normals_sphere", "normals_ellipsoid")),
    Picture("surface_pipeline", pipeline_data, pipeline_picture, ("stages",)),
)
