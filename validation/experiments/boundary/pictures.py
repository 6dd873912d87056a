"""Pictures of sampling, signed distance and liquid at meshes, each drawn from its own data file."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import EllipseCollection
from scipy.spatial import cKDTree

from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION, caption, headline, packed, unpacked, view_matrix
from validation.experiment import Picture, Results
from validation.experiments.boundary.runs import ARMS, POUR, RAINED
from validation.experiments.boundary.scene import SHAPES
from validation.results import real

VIEW = view_matrix(azimuth=32.0, elevation=24.0)
COLOURS = {"sphere": BLUE, "torus": GREEN, "cube": VERMILION, "organic": ORANGE}


def shape_data(results: Results) -> dict[str, Any]:
    """Particles, whether each faces the viewer, and numbers of every shape."""
    made: dict[str, Any] = {"title": "Boundary particles", "shapes": {}}
    for shape in SHAPES:
        result = results[f"sampling_{shape}"]
        v = result.values
        towards = np.round(result.arrays["normal"], 3) @ VIEW[2]
        made["shapes"][shape] = {
            "position_tenth_millimetres": packed(np.round(1e4 * result.arrays["position"]).astype(np.int16)),
            "facing": packed((towards > -0.05).astype(np.uint8)),
            **{k: v[k] for k in ("radius", "particles", "least", "variation", "mean_over_2r", "iterations", "holes")},
        }  # fmt: skip
    return made


def shape_picture(data: Mapping[str, Any]) -> Any:
    """One panel a shape: the particles that face the viewer, coloured by the distance to the nearest one."""
    figure, panels = plt.subplots(2, 3, figsize=(10.2, 7.0))
    last = None
    for axes, (shape, row) in zip(panels.flat, data["shapes"].items()):
        position = 1e-4 * unpacked(row["position_tenth_millimetres"], "int16", 3) @ VIEW.T
        nearest = cKDTree(position).query(position, k=2)[0][:, 1] / (2 * row["radius"])
        order = np.argsort(position[:, 2])
        order = order[unpacked(row["facing"], "uint8")[order] > 0]
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
        label = f"least/mean {row['least']:.3f}, variation {row['variation']:.3f}"
        caption(axes, f"{label}\n{row['iterations']} iterations, {row['holes']} holes")
    figure.colorbar(last, ax=panels, shrink=0.6, label="distance to the nearest particle / 2 r")
    return figure


# Liquid at meshes


def pour_data(results: Results) -> dict[str, Any]:
    """Parts and holes of the liquid, half-way and at the end, of every shape and arm that was run."""
    rows = []
    for shape in POUR:
        for arm, label in ARMS.items():
            if f"flow_pour_{shape}_{arm}" in results:
                seen = results[f"flow_pour_{shape}_{arm}"].values["frames"]
                frames = [{"time_s": f["time"], "components": f["components"], "holes": f["holes"]}
                          for f in (seen[2], seen[5])]  # fmt: skip
                rows.append({"shape": shape, "arm": label, "frames": frames})
    return {"title": "Liquid poured on solids, by tension", "rows": rows}


def pour_picture(data: Mapping[str, Any]) -> Any:
    """Holes of the liquid at the end on all solids, a bar for each arm."""
    shapes = list(dict.fromkeys(row["shape"] for row in data["rows"]))
    arms = dict(zip(dict.fromkeys(row["arm"] for row in data["rows"]), (GREY, BLUE, VERMILION)))
    figure, axes = plt.subplots(figsize=(7.2, 3.4))
    for n, (arm, shade) in enumerate(arms.items()):
        there = [(shapes.index(r["shape"]) + 0.27 * (n - 1), r["frames"][-1]["holes"]) for r in data["rows"]
                 if r["arm"] == arm]  # fmt: skip
        axes.bar_label(axes.bar(*zip(*there), 0.25, color=shade, label=arm), fontsize=9)
    axes.set_xticks(range(len(shapes)), shapes)
    axes.set_ylabel("holes of the liquid at the end")
    axes.margins(y=0.2)
    axes.legend(fontsize=9, loc="upper left", ncols=3)
    headline(figure, "Cohesion closes holes of poured liquid; the difference of normals does not", 10.5)
    return figure


def rain_data(results: Results) -> dict[str, Any]:
    """Particles inside after any step, by step, shape and correction; null where it was not run."""
    keys = [key.split("_")[2:] for key in results if key.startswith("flow_rain_")]
    shapes = list(dict.fromkeys(key[0] for key in keys))
    shares = sorted({float(key[2]) for key in keys})

    def found(name: str, shape: str, correction: str, share: float) -> float | None:
        result = results.get(f"flow_rain_{shape}_{correction}_{share:g}")
        return None if result is None else real(result.values[name])

    def table(name: str) -> dict[str, dict[str, list[float | None]]]:
        return {f"{s:g}": {c: [found(name, shape, c, s) for shape in shapes] for c in RAIN_WORDS} for s in shares}

    return {
        "title": "Rain of 2,560 particles at 2 m/s: found inside the solid after a step",
        "shapes": shapes, "inside": table("ever_inside"), "deepest_spacings": table("deepest_spacings"),
    }  # fmt: skip


RAIN_WORDS = {
    "none": ("no correction", VERMILION), "point": ("where the step ends", GREY), "swept": ("swept correction", BLUE),
}  # fmt: skip


def rain_picture(data: Mapping[str, Any]) -> Any:
    """A panel a step, bars by shape."""
    panels = data["inside"]
    figure, axes = plt.subplots(len(panels), 1, figsize=(7.2, 1.7 * len(panels) + 0.6), sharex=True, squeeze=False)
    at = np.arange(len(data["shapes"]))
    for place, (share, rows) in zip(axes[:, 0], panels.items()):
        for shift, (key, (label, colour)) in zip((-0.27, 0.0, 0.27), RAIN_WORDS.items()):
            known = [k for k, value in enumerate(rows[key]) if value is not None]
            if known:
                values = [rows[key][k] for k in known]
                bars = place.bar(at[known] + shift, values, 0.26, color=colour, label=label)
                place.bar_label(bars, fmt="%d", fontsize=7, padding=1)
        place.margins(y=0.25)
        place.set_ylabel("particles")
        label = "the runner's own step" if share == "1" else f"{share} times the runner's step"
        place.set_title(label, fontsize=9, loc="left")
    first = next((p for p in axes[:, 0] if len(p.get_legend_handles_labels()[0]) == len(RAIN_WORDS)), axes[0, 0])
    figure.legend(*first.get_legend_handles_labels(), loc="outside lower center", fontsize=8, ncols=3)
    axes[-1, 0].set_xticks(at, data["shapes"])
    figure.suptitle(data["title"], fontsize=10.5, fontweight="bold")
    return figure


PICTURES = (
    Picture("boundary_sampling", shape_data, shape_picture, tuple(f"sampling_{s}" for s in SHAPES), shaded=True),
    Picture("boundary_pouring", pour_data, pour_picture, ("flow_pour_sphere_difference",), shaded=True),
    Picture("boundary_penetration", rain_data, rain_picture,
            tuple(f"flow_rain_{s}_{c}_1" for s in RAINED for c in ("none", "swept"))),
)  # fmt: skip
