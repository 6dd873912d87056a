"""Pictures of the MPM droplet."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection

from validation import drawing
from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION, WATER, packed, unpacked
from validation.experiment import Picture, Results
from validation.results import floats


def square_data(results: Results) -> dict[str, Any]:
    """Particles [cells] at four times, and energies over time."""
    result = results["square_cluster"]
    count, series = len(result.values["shown"]), result.values["series"]
    return {
        "title": "A square of liquid becomes a disc", "times": result.values["shown"],
        "frames": [result.arrays[f"position_{k}"].round(3).tolist() for k in range(count)],
        "surfaces": frames_of(result, count), "series": chosen(series, *ENERGIES),
    }  # fmt: skip


def square_picture(data: Mapping[str, Any]) -> Any:
    """Particles and reconstructed surface at four times, the energy ledger below."""
    figure, places = plt.subplot_mosaic(
        [["0", "1", "2", "3"], ["energy"] * 4], figsize=(8.6, 5.4), height_ratios=(1, 1.2), layout="constrained"
    )
    points = np.concatenate(data["frames"])
    low, high = points.min(0) - 0.64, points.max(0) + 0.64
    for k, (at, frame) in enumerate(zip(data["times"], data["frames"])):
        axes = places[str(k)]
        axes.scatter(*np.transpose(frame), s=1.6, color=BLUE, linewidths=0)
        outline(axes, data["surfaces"][k], VERMILION)
        axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        axes.set(title=f"{at:g} s", xticks=[], yticks=[])
        axes.grid(False)
    axes = places["energy"]
    ledger_lines(axes, data["series"])
    axes.set(ylabel="energy [J/m]", title="energy ledger", xlim=(0, data["series"]["time"][-1]))
    axes.set_ylim(bottom=0)
    return figure


VIEW = drawing.view_matrix(azimuth=32.0, elevation=24.0)
LEDGER = (
    ("energy", "all", GREY), ("surface", "surface", VERMILION), ("kinetic", "motion", BLUE), ("bulk", "bulk", GREEN),
)  # fmt: skip


def frames_of(result: Any, count: int) -> list[dict[str, Any]]:
    """Surfaces of a run, in hundredths of a cell."""
    made = []
    for k in (k for k in range(count) if f"vertices_{k}" in result.arrays):
        vertices = np.round(100 * result.arrays[f"vertices_{k}"]).astype(np.int16)
        facets = result.arrays[f"facets_{k}"].astype(np.int32)
        made.append({"vertices": packed(vertices), "facets": packed(facets), "corners": facets.shape[1]})
    return made


def vertices_of(frame: Mapping[str, Any]) -> np.ndarray:
    """Vertices (v, 3) of a frame's surface, in cells."""
    return 0.01 * unpacked(frame["vertices"], "int16", 3)


def facets_of(frame: Mapping[str, Any]) -> np.ndarray:
    """Facets (f, 2) or (f, 3) of a frame's surface."""
    return unpacked(frame["facets"], "int32", frame["corners"])


def shaded(axes: Any, frame: Mapping[str, Any], extent: float, middle: Any = None) -> None:
    """A lit surface, its middle (or the given one) in the middle of the panel."""
    v = vertices_of(frame)
    v = v - (v.mean(0) if middle is None else middle)
    drawing.show_image(axes, drawing.surface_picture(v, facets_of(frame), WATER, VIEW, extent, 420), extent)


def ledger_lines(axes: Any, series: Mapping[str, Any], names: Any = LEDGER) -> None:
    """Energies over time."""
    for name, label, colour in names:
        wide = 2.2 if name == "energy" else 1.4
        axes.plot(series["time"], series[name], color=colour, label=label, linewidth=wide)
    axes.set_xlabel("time [s]")
    axes.grid(axis="y")
    axes.legend(ncols=2, loc="center right")


def chosen(series: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Some of a ledger's series, with its time."""
    return {name: series[name] for name in ("time", *names)}


ENERGIES = ("energy", "surface", "kinetic", "bulk")


# Runs whose surfaces are shown over time
SURFACES = {  # the left half of the picture, then the right one
    "square_cluster": "square, 20 h", "rest_2d_11_default": "disc, R = 11 h", "collision_2d": "two discs, R = 8 h",
    "cube": "cube, 10 h",
}  # fmt: skip


def outline(axes: Any, frame: Mapping[str, Any], colour: str) -> None:
    """A reconstructed outline in the plane, in cells."""
    corner = vertices_of(frame)[facets_of(frame)][:, :, :2]
    axes.add_collection(LineCollection(corner, colors=colour, linewidths=1.2, capstyle="round"))


def surfaces_data(results: Results) -> dict[str, Any]:
    """Reconstructed surfaces of each scene at four times."""
    rows = []
    for key, label in SURFACES.items():
        values = results[key].values
        times = values["shown"]
        rows.append({"words": label, "space": "vertices_0" in results[key].arrays
                     and results[key].arrays["facets_0"].shape[1] == 3, "times": times,
                     "frames": frames_of(results[key], len(times))})  # fmt: skip
    return {"title": "Reconstructed surfaces over time", "rows": rows}


def surfaces_picture(data: Mapping[str, Any]) -> Any:
    """Scenes in two halves; time goes from left to right."""
    lines = (len(data["rows"]) + 1) // 2
    halves = [data["rows"][:lines], data["rows"][lines:]]
    count = max(len(row["frames"]) for row in data["rows"])
    figure, panels = plt.subplots(lines, 2 * count, figsize=(13.2, 1.75 * lines))
    for axes in panels.flat:
        axes.set_axis_off()
    for side, half in enumerate(halves):
        for line, row in zip(panels[:, side * count : (side + 1) * count], half):
            places = [vertices_of(f) for f in row["frames"]]
            if row["space"]:  # seen from any side
                extent = 1.02 * max(np.linalg.norm(p - middle_of(p), axis=1).max() for p in places)
            else:
                extent = 1.08 * max(np.abs(p - middle_of(p)).max() for p in places)
            for k, (axes, frame, place) in enumerate(zip(line, row["frames"], places)):
                middle = middle_of(place)
                if row["space"]:
                    shaded(axes, frame, extent, middle=middle)
                else:
                    outline(axes, frame, BLUE)
                    middle = middle_of(vertices_of(frame))
                    axes.set(xlim=(middle[0] - extent, middle[0] + extent))
                    axes.set(ylim=(middle[1] - extent, middle[1] + extent), aspect="equal")
                label = f"{row['times'][k]:.3g} s"
                drawing.plain_title(axes, f"{row['words']}: {label}" if k == 0 else label, fontsize=8)
    return figure


def middle_of(place: np.ndarray) -> np.ndarray:
    """The middle of the box round all places."""
    return 0.5 * (place.min(0) + place.max(0))


def box_data(results: Results) -> dict[str, Any]:
    """Surfaces of the box that becomes a ball, its ledgers, and its shape with and without viscosity."""
    box, other = results["box"], results["box_default"]
    return {
        "title": "A turned box of 1.3 : 1 : 0.8 becomes a ball", "times": box.values["shown"],
        "frames": frames_of(box, len(box.values["shown"])), "particles": box.values["particles"],
        "series": chosen(box.values["series"], *ENERGIES, "momentum", "angular", "centre", "sphericity", "volume",
                         "anisotropy", "pressure"),
        "default": chosen(other.values["series"], "sphericity", "volume", "anisotropy"),
        "scales": [box.values["momentum"], box.values["angular"]],
    }  # fmt: skip


def box_picture(data: Mapping[str, Any]) -> Any:
    """Lit surfaces above; energies, drifts and shape below."""
    count = len(data["frames"])
    figure = plt.figure(figsize=(10.4, 5.2))
    above, below = figure.subfigures(2, 1, height_ratios=(1, 1.9))
    extent = 1.04 * max(np.abs(vertices_of(f) - vertices_of(f).mean(0)).max() for f in data["frames"])
    for axes, at, frame in zip(above.subplots(1, count), data["times"], data["frames"]):
        shaded(axes, frame, extent)
        drawing.plain_title(axes, f"{at:g} s")
    energy, drift, shape = below.subplots(1, 3)
    ledger_lines(energy, data["series"])
    energy.set_ylabel("energy [J]")
    energy.set_ylim(bottom=0)
    energy.set_title("Energy ledger")
    time = data["series"]["time"]
    for (name, words, colour), scale in zip(
        (("momentum", "momentum / m v$_{max}$", BLUE), ("angular", "angular momentum / m v$_{max}$ R", ORANGE)),
        data["scales"],
    ):
        values = floats(data["series"][name])
        drift.semilogy(time, np.maximum(values / values.max() * scale, 1e-20), color=colour, label=words)
    drift.semilogy(time, np.maximum(floats(data["series"]["centre"]), 1e-20), color=GREEN, label="centre / h")
    drift.set(ylim=(1e-19, 1e0), xlabel="time [s]")
    drift.grid(axis="y")
    drift.legend(loc="upper right")
    drift.set_title("Drifts")
    for series, line, label in ((data["series"], "-", True), (data["default"], ":", False)):
        for name, colour in (("volume", GREEN), ("sphericity", VERMILION), ("anisotropy", BLUE)):
            shape.plot(series["time"], series[name], line, color=colour, label=name if label else None)
    shape.set(xlabel="time [s]; dotted: no viscosity, inset h/4", ylim=(0, 1.1))
    shape.grid(axis="y")
    shape.legend(loc="center right")
    shape.set_title("Shape")
    return figure


PICTURES = (
    Picture("mpm_square", square_data, square_picture, ("square_cluster",)),
    Picture("mpm_surfaces", surfaces_data, surfaces_picture, tuple(SURFACES), shaded=True),
    Picture("mpm_box", box_data, box_picture, ("box", "box_default")),
)
