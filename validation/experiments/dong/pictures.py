"""Pictures of Dong's scenes, each drawn from its own data file."""

import statistics
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

from validation.drawing import BLUE, GREY, ORANGE, plain_title, show_balls, thousandths, view_matrix
from validation.experiment import Picture, Results
from validation.experiments.dong import runs
from validation.experiments.dong import scene as scenes
from validation.experiments.dong.runs import NEEDS
from validation.results import Result

TOP, SIDE_VIEW = view_matrix(azimuth=-90.0, elevation=90.0), view_matrix(azimuth=-90.0, elevation=1.0)
COLOURS = [(0.16, 0.50, 0.80), (0.90, 0.45, 0.13), (0.20, 0.62, 0.40), (0.65, 0.35, 0.65), (0.80, 0.65, 0.15)]
GLASS = (0.55, 0.72, 0.86)  # of what belongs to no larger part
OBLIQUE = view_matrix(azimuth=12.0, elevation=9.0)
ROOM_EXTENT, CUBE_EXTENT = 0.54, 0.4  # half widths [m]
MILLI = 1e-3


def _room(result: Result, frame: int) -> dict[str, Any]:
    """The liquid at a frame, with the number of each particle's part (-1: of a small one)."""
    from validation.metrics.spread import parts

    values = result.values
    k = next(k for k, row in enumerate(values["rows"]) if row["frame"] == frame)
    x = result.arrays["position"][k].astype(float)
    part = parts(x, values["spacing"])
    sizes = np.bincount(part)
    part = np.where(sizes[part] >= 5, part, -1)
    kept = ("frame", "time", "parts", "lone", "holes", "largest", "stretch", "layers")
    return {
        **{name: values["rows"][k][name] for name in kept},
        "position_mm": thousandths(x), "part": part,
    }  # fmt: skip


def _middle(view: NDArray) -> NDArray:
    """What stands in the middle of a picture of the room."""
    return np.array([0.0, 0.0, 0.0 if view is TOP else 0.16])


def _draw_room(place: Any, frame: Mapping[str, Any], spacing: float, view: NDArray) -> None:
    x = np.array(frame["position_mm"], dtype=float).reshape(-1, 3) * MILLI - _middle(view)
    part = np.array(frame["part"], dtype=int)
    colour = np.array([GLASS if p < 0 else COLOURS[p % len(COLOURS)] for p in part]).reshape(-1, 3)
    show_balls(place, x, spacing, colour, view, ROOM_EXTENT, 420)
    half = 0.5 * scenes.ROOM + 0.5 * spacing
    if view is TOP:
        place.plot([-half, half, half, -half, -half], [-half, -half, half, half, -half], color=GREY, linewidth=0.8)
    else:
        floor = -_middle(view)[2] - 0.5 * spacing
        place.plot([-half, half], [floor, floor], color=GREY, linewidth=0.8)


def _counts(frame: Mapping[str, Any], *names: str) -> str:
    """Counts in words: 1 part, 2 parts."""
    return ", ".join(f"{frame[name]} {name if frame[name] != 1 else name[:-1]}" for name in names)


def cube_data(results: Results) -> dict[str, Any]:
    """Figure 3: the cube, half way to a ball, the ball, the octahedron, half way back, and at the end."""
    values, position = results["cube_4913"].values, results["cube_4913"].arrays["position"].astype(float)
    moment = np.array(values["series"]["moment"])
    top = int(np.argmax(moment))
    ball = int(np.argmin(np.abs(moment[:top])))
    after = top + int(np.argmax(moment[top:] <= 0))
    rows = []
    for k in (0, ball // 2, ball, top, after, len(moment) - 1):
        x = position[k] - position[k].mean(0)
        rows.append({"time": values["series"]["time"][k], "moment": moment[k], "position_mm": thousandths(x)})
    return {
        "title": f"Dong, figure 3: a cube of 0.5 m without gravity, {values['particles']:,} particles",
        "spacing_m": values["spacing"], "rows": rows,
    }  # fmt: skip


def cube_picture(data: Mapping[str, Any]) -> Any:
    """Draw figure 3."""
    figure, axes = plt.subplots(1, len(data["rows"]), figsize=(10.4, 2.4))
    for place, row in zip(axes, data["rows"]):
        x = np.array(row["position_mm"], dtype=float) * MILLI
        show_balls(place, x, data["spacing_m"], COLOURS[0], OBLIQUE, CUBE_EXTENT, 420)
        plain_title(place, f"{row['time']:.2f} s: q4 {round(row['moment'], 3) + 0.0:+.3f}", fontsize=8)  # no -0.000
    figure.suptitle(f"{data['title']}; q4: cube < 0 < octahedron", fontsize=10.5, fontweight="bold")
    return figure


def splash_data(results: Results) -> dict[str, Any]:
    """Figure 4: from above at frames 60 to 90, with and without tension."""
    frames = (*scenes.FRAMES, *scenes.LATER)
    return {
        "title": "Dong, figure 4: the block after its impact, from above",
        "spacing_m": results["rest_with"].values["spacing"],
        "rows": [{"words": label, "frames": [_room(results[f"rest_{arm}"], frame) for frame in frames]}
                 for arm, label in ARMS.items()],
    }  # fmt: skip


ARMS = {"with": "with tension", "without": "without tension"}


SPLASH_SHOWN = (60, 70, 80, 90, 120)  # frames of the splash that its picture shows


def splash_picture(data: Mapping[str, Any]) -> Any:
    """Draw figure 4: an arm a row, all liquid in one colour."""
    rows = []
    for row in data["rows"]:
        rows.append((row["words"], [f for f in row["frames"] if f["frame"] in SPLASH_SHOWN] or row["frames"]))
    figure, axes = plt.subplots(len(rows), len(rows[0][1]), figsize=(10.4, 5.9), squeeze=False)
    for line, (label, frames) in enumerate(rows):
        for column, frame in enumerate(frames):
            place = axes[line][column]
            _draw_room(place, {**frame, "part": [0] * len(frame["part"])}, data["spacing_m"], TOP)
            counts = f"frame {frame['frame']}: {_counts(frame, 'parts')}, {frame['lone']} lone"
            plain_title(place, counts, fontsize=8)
        axes[line][0].text(-0.04, 0.5, label, transform=axes[line][0].transAxes, rotation=90, ha="right",
                           va="center", fontsize=9.5)  # fmt: skip
    last = [frames[-1] for _, frames in rows]
    message = " and ".join(f"{frame['lone']} {label}" for (label, _), frame in zip(rows, last))
    figure.suptitle(f"{data['title']}; lone particles at frame {last[0]['frame']}: {message}", fontsize=10.5,
                    fontweight="bold")  # fmt: skip
    return figure


def rest_data(results: Results) -> dict[str, Any]:
    """Figure 5: from the side at rest, with and without tension."""
    rows = [{"words": w, **_room(results[f"rest_{arm}"], scenes.REST)} for arm, w in ARMS.items()]
    spacing = results["rest_with"].values["spacing"]
    return {"title": "Dong, figure 5: at rest, from the side", "spacing_m": spacing, "rows": rows}


def rest_picture(data: Mapping[str, Any]) -> Any:
    """Draw figure 5."""
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 1.9))
    for place, row in zip(axes, data["rows"]):
        _draw_room(place, row, data["spacing_m"], SIDE_VIEW)
        place.set_ylim(-0.2, -0.05)
        plain_title(place, f"{row['words']}: {_counts(row, 'layers', 'parts')}, {row['lone']} lone", fontsize=9)
    figure.suptitle(data["title"] + f" ({data['rows'][0]['time']:.1f} s)", fontsize=10.5, fontweight="bold")
    return figure


def merging_data(results: Results) -> dict[str, Any]:
    """Figure 6: droplets become one, from above."""
    result = results["rest_with"]
    rows = result.values["rows"]
    return {
        "title": "Dong, figure 6: the droplets merge", "spacing_m": result.values["spacing"],
        "frames": [_room(result, frame) for frame in scenes.MERGING],
        "series": {name: [row[name] for row in rows] for name in ("time", "parts", "lone", "largest")},
    }  # fmt: skip


def merging_picture(data: Mapping[str, Any]) -> Any:
    """Draw figure 6: eight moments, and the number of parts over time."""
    figure = plt.figure(figsize=(9.6, 7.4))
    grid = figure.add_gridspec(3, 4, height_ratios=(1.0, 1.0, 0.75))
    for k, frame in enumerate(data["frames"]):
        place = figure.add_subplot(grid[k // 4, k % 4])
        _draw_room(place, frame, data["spacing_m"], TOP)
        plain_title(place, f"{frame['time']:.2f} s: {_counts(frame, 'parts')}, {frame['lone']} lone", fontsize=8)
    axes = figure.add_subplot(grid[2, :])
    series = data["series"]
    axes.plot(series["time"], series["parts"], color=BLUE, marker="o", markersize=3, label="parts of 5 and more")
    axes.plot(series["time"], series["lone"], color=ORANGE, marker="o", markersize=3, label="lone particles")
    axes.set(xlabel="time [s]", ylabel="number", xscale="log", ylim=(0, None))
    axes.set_xticks((0.3, 0.5, 1, 2, 4, 8), ("0.3", "0.5", "1", "2", "4", "8"))
    axes.set_xticks((), minor=True)
    axes.legend()
    axes.grid(True)
    figure.suptitle(data["title"], fontsize=10.5, fontweight="bold")
    return figure


PICTURES = (
    Picture("dong_figure_3", cube_data, cube_picture, ("cube_4913",), shaded=True),
    Picture("dong_figure_4", splash_data, splash_picture, ("rest_with", "rest_without"), shaded=True),
    Picture("dong_figure_5", rest_data, rest_picture, ("rest_with", "rest_without")),
    Picture("dong_figure_6", merging_data, merging_picture, ("rest_with",), shaded=True),
)


# Picture of Dong's table 1.


TABLE_1_COLOURS = {"dong": BLUE, "iif": ORANGE, "csf": GREY}


def data(results: Results) -> dict[str, Any]:
    """Milliseconds of a frame, turn by turn."""
    rows: dict[tuple[str, str], list[float]] = {}
    for result in results.values():
        values = result.values
        rows.setdefault((values["case"], values["model"]), []).append(1e3 * runs.per_frame(values))
    first = next(iter(results.values()))
    return {
        "title": "Dong, table 1: time per frame of 5 ms", "machine": first.about.get("machine"),
        "date": first.about.get("date"), "threads": first.values["threads"],
        "particles": {result.values["case"]: result.values["particles"] for result in results.values()},
        "rows": [{"case": case, "model": model, "frame_ms": times, "median_ms": statistics.median(times)}
                 for (case, model), times in rows.items()],
    }  # fmt: skip


def picture(data: Mapping[str, Any]) -> Any:
    """A group of bars for each scene; marks are the turns."""
    titles = {"droplet": "the cube, {:,} particles", "oil": "twelve drops of one oil, {:,} particles"}
    cases = list(data["particles"])
    longest = max(max(r["frame_ms"]) for r in data["rows"])
    figure, axes = plt.subplots(figsize=(7.6, 3.0))
    for k, (model, colour) in enumerate(TABLE_1_COLOURS.items()):
        for line, case in enumerate(cases):
            ms = next(r["frame_ms"] for r in data["rows"] if (r["case"], r["model"]) == (case, model))
            y = -line + 0.27 * (1 - k)
            label = scenes.MODELS[model] if line == 0 else None
            axes.barh(y, statistics.median(ms), 0.24, color=colour, label=label)
            axes.plot(ms, np.full(len(ms), y), "|", color="black", ms=7)
            axes.text(max(ms) + 0.012 * longest, y, f"{statistics.median(ms):.1f}", va="center", fontsize=8)
    axes.set_yticks([-line for line in range(len(cases))], [titles[c].format(data["particles"][c]) for c in cases])
    said = f"milliseconds a frame, {data['threads'] or 'all'} threads; bars: medians, strokes: single turns"
    axes.set(xlabel=said, xlim=(0, 1.1 * longest), title=data["title"])
    axes.grid(True, axis="x")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    return figure


TABLE_1_PICTURES = (Picture("dong_table_1", data, picture, NEEDS),)
