"""Pictures of sampling, each drawn from its own data file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection

from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION, view_matrix
from validation.experiment import Results
from validation.experiments.boundary.sampling_shapes import SHAPES
from validation.results import floats

VIEW = view_matrix(azimuth=32.0, elevation=24.0)
COLOURS = {"sphere": BLUE, "torus": GREEN, "cube": VERMILION, "organic": ORANGE}


def shape_data(results: Results) -> dict[str, Any]:
    """Particles, normals and numbers of every shape."""
    made: dict[str, Any] = {"title": "Boundary particles", "shapes": {}}
    for shape in SHAPES:
        result = results[f"sampling_{shape}"]
        v = result.values
        made["shapes"][shape] = {
            "position": np.round(result.arrays["position"], 4), "normal": np.round(result.arrays["normal"], 3),
            **{k: v[k] for k in ("radius", "particles", "least", "variation", "mean_over_2r", "iterations", "holes")},
        }  # fmt: skip
    return made


def shape_picture(data: Mapping[str, Any]) -> Any:
    """One panel a shape: the particles that face the viewer, coloured by the distance to the nearest one."""
    from scipy.spatial import cKDTree

    figure, panels = plt.subplots(2, 3, figsize=(10.2, 7.0))
    last = None
    for axes, (shape, row) in zip(panels.flat, data["shapes"].items()):
        position, normal = floats(row["position"]) @ VIEW.T, floats(row["normal"]) @ VIEW.T
        nearest = cKDTree(position).query(position, k=2)[0][:, 1] / (2 * row["radius"])
        order = np.argsort(position[:, 2])
        order = order[normal[order, 2] > -0.05]
        size = np.full(len(order), 1.7 * row["radius"])
        last = EllipseCollection(
            size, size, np.zeros(len(order)), units="xy", offsets=position[order, :2], transOffset=axes.transData,
            array=nearest[order], cmap="viridis", edgecolors="black", linewidths=0.15,
        )  # fmt: skip
        last.set_clim(0.75, 1.0)
        axes.add_collection(last)
        low, high = position[:, :2].min(0), position[:, :2].max(0)
        middle, reach = 0.5 * (low + high), 0.54 * (high - low).max()
        axes.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
        axes.set(aspect="equal")
        axes.set_axis_off()
        axes.set_title(f"{shape.capitalize()}: {row['particles']:,} particles")
        axes.text(
            0.5, -0.02,
            f"least/mean {row['least']:.3f}, variation {row['variation']:.3f}\n{row['iterations']} iterations,"
            f" {row['holes']} holes",
            transform=axes.transAxes, ha="center", va="top", fontsize=8, color=GREY,
        )  # fmt: skip
    figure.colorbar(last, ax=panels, shrink=0.6, label="distance to the nearest particle / 2 r")
    return figure


def convergence_data(results: Results) -> dict[str, Any]:
    """Ways of the iterations, adopted and printed, and errors of the distance over the spacing."""
    printed = results["sampling_printed"]
    made: dict[str, Any] = {
        "title": "Relaxation and distance", "adopted": printed.arrays["adopted"], "printed": printed.arrays["printed"],
        "distance": {},
    }  # fmt: skip
    for shape in COLOURS:
        made["distance"][shape] = results[f"distance_{shape}"].values["rows"]
    return made


def convergence_picture(data: Mapping[str, Any]) -> Any:
    """The sum of ways; the error of the trilinear distance over the grid's spacing and over its bytes."""
    figure, (left, right, bytes_axes) = plt.subplots(1, 3, figsize=(13.2, 3.8))
    for name, colour in (("printed", ORANGE), ("adopted", BLUE)):
        ways = floats(data[name])
        words = {"printed": "as printed (patent E24)", "adopted": "adopted: the step decays"}[name]
        left.semilogy(np.arange(1, len(ways) + 1), ways, color=colour, label=words)
    left.axhline(2e-3, color=GREY, linestyle="--", linewidth=1)
    left.text(0.99, 2.1e-3, "threshold", transform=left.get_yaxis_transform(), ha="right", va="bottom", color=GREY)
    left.set(xlabel="iteration", ylabel=r"$\Sigma|\Delta x|\,/\,(r N)$", title="Relaxation on a cube")
    left.legend()
    left.grid()
    bytes_axes.sharey(right)
    for shape, rows in data["distance"].items():
        for axes, key in ((right, "spacing"), (bytes_axes, "bytes")):
            over = [row[key] for row in rows]
            axes.loglog(over, [row["rms"] for row in rows], "o-", color=COLOURS[shape], label=shape)
    guide = np.array([0.05, 0.2])
    right.loglog(guide, 0.02 * guide**2, "--", color=GREY, label="second order")
    right.set(xlabel="grid spacing [m]", ylabel="rms error of the distance [m]")
    right.set(title="Trilinear distance near the surface")
    right.xaxis.set(major_formatter="{x:g}", minor_formatter="")
    right.set_xticks([0.05, 0.1, 0.2])
    right.legend()
    right.grid()
    bytes_axes.set(xlabel="bytes of the narrow band", title="The same, over its memory")
    bytes_axes.grid()
    return figure
