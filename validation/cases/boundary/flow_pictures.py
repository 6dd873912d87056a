"""Pictures of liquid at meshes, each drawn from its own data file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from validation.cases.boundary.flow_runs import ARMS, DENSITY, GRAVITY, POUR, SPACING
from validation.drawing import BLUE, GREY, VERMILION, ball_picture, show_image, view_matrix, visible_balls
from validation.harness import Results
from validation.results import real

VIEW = view_matrix(azimuth=32.0, elevation=22.0)
EXTENT = 0.17  # half width of a frame [m]
WATER, SOLID = (0.16, 0.50, 0.80), (0.72, 0.66, 0.58)
MILLI = 1e-4  # unit of stored coordinates [m]


def pour_data(results: Results) -> dict[str, Any]:
    """The particles that can be seen, half-way and at the end, of every shape and arm."""
    rows = []
    for shape in POUR:
        for arm, words in ARMS.items():
            result = results[f"flow_pour_{shape}_{arm}"]
            solid = result.arrays["solid"].astype(float)
            frames = []
            for k in (2, 5):
                liquid = result.arrays["position"][k].astype(float)
                both = np.vstack([liquid, solid])
                seen = visible_balls(both, 0.5 * SPACING, VIEW, EXTENT)
                frame = result.values["frames"][k]
                frames.append(
                    {
                        "time_s": frame["time"], "components": frame["components"], "holes": frame["holes"],
                        "liquid": np.rint(both[seen[seen < len(liquid)]] / MILLI).astype(int),
                        "solid": np.rint(both[seen[seen >= len(liquid)]] / MILLI).astype(int),
                    }
                )  # fmt: skip
            rows.append({"shape": shape, "arm": words, "frames": frames})
    return {"title": "Liquid poured on solids, by tension", "rows": rows}


def pour_picture(data: Mapping[str, Any]) -> Any:
    """A shape a row; half-way and at the end of each arm."""
    import matplotlib.pyplot as plt

    shapes = list(dict.fromkeys(row["shape"] for row in data["rows"]))
    arms = list(dict.fromkeys(row["arm"] for row in data["rows"]))
    figure, axes = plt.subplots(len(shapes), 2 * len(arms), figsize=(2.05 * 2 * len(arms), 2.25 * len(shapes)))
    for row in data["rows"]:
        for k, frame in enumerate(row["frames"]):
            place = axes[shapes.index(row["shape"])][2 * arms.index(row["arm"]) + k]
            place.set_axis_off()
            liquid = np.array(frame["liquid"], dtype=float).reshape(-1, 3) * MILLI
            solid = np.array(frame["solid"], dtype=float).reshape(-1, 3) * MILLI
            x = np.vstack([liquid, solid])
            colour = np.vstack([np.broadcast_to(WATER, liquid.shape), np.broadcast_to(SOLID, solid.shape)])
            show_image(place, ball_picture(x, 0.5 * SPACING, colour, VIEW, EXTENT, 260), EXTENT)
            words = f"{frame['time_s']:.2f} s: {frame['components']} parts, {frame['holes']} holes"
            place.text(0.5, 0.0, words, transform=place.transAxes, ha="center", va="top", fontsize=7, color="#444444")
            if shapes.index(row["shape"]) == 0 and k == 0:
                place.set_title(row["arm"], fontsize=8.5, loc="left")
    figure.suptitle(data["title"], fontsize=10.5, fontweight="bold")
    return figure


def rain_data(results: Results) -> dict[str, Any]:
    """Particles inside after any step, by shape, with and without the correction; depth."""
    shapes = [key.split("_")[2] for key in results if key.startswith("flow_rain_") and key.endswith("_swept_1")]
    own = {c: [results[f"flow_rain_{s}_{c}_1"].values for s in shapes] for c in ("none", "swept")}
    return {
        "title": "Rain of 2,560 particles: found inside the solid after a step",
        "shapes": shapes,
        "inside": {c: [v["ever_inside"] for v in own[c]] for c in own},
        "deepest_spacings": {c: [real(v["deepest_spacings"]) for v in own[c]] for c in own},
    }


def rain_picture(data: Mapping[str, Any]) -> Any:
    """Bars by shape."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(6.6, 3.4))
    at = np.arange(len(data["shapes"]))
    for shift, (key, words, colour) in zip(
        (-0.2, 0.2), (("none", "no correction", VERMILION), ("swept", "swept correction", BLUE))
    ):
        bars = axes.bar(at + shift, data["inside"][key], 0.38, color=colour, label=words)
        axes.bar_label(bars, fontsize=8, padding=2)
    axes.set_xticks(at, data["shapes"])
    axes.set_ylabel("particles")
    axes.margins(y=0.15)
    axes.set_title(data["title"])
    axes.legend()
    return figure


def tank_data(results: Results) -> dict[str, Any]:
    """Pressure of every particle by height, mean of the last tenth of the steps."""
    result = results["flow_tank"]
    return {
        "title": "A tank at rest: pressure by height, over 10,000 steps",
        "height_m": result.arrays["height"].round(5),
        "pressure_pa": result.arrays["pressure"].round(2),
        "surface_m": real(result.values["surface_m"]),
        "level_m": real(result.values["level_m"]),
    }


def tank_picture(data: Mapping[str, Any]) -> Any:
    """Dots, and the hydrostatic line."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(5.6, 3.8))
    axes.plot(data["pressure_pa"], data["height_m"], ".", color=BLUE, markersize=2.5, label="particles")
    z = np.linspace(0, data["level_m"], 20)
    axes.plot(DENSITY * GRAVITY * (data["level_m"] - z), z, color=GREY, label=r"$\rho_0 g (z_s - z)$")
    axes.set(xlabel="pressure [Pa]", ylabel="height [m]")
    axes.set_title(data["title"])
    axes.legend()
    return figure
