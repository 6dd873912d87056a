"""Pictures of the MPM droplet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from validation import drawing
from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION, WATER, packed, unpacked
from validation.experiment import Picture, Results
from validation.experiments.mpm_droplet import runs as fine_runs
from validation.experiments.mpm_droplet.runs import orders, pressures
from validation.metrics.droplet import contour
from validation.results import floats, real

COLOURS = {"none": GREY, "cluster": BLUE, "thesis": VERMILION, "gradient_corrected": ORANGE}
FLOOR = 1e-17  # where an error that is exactly zero is drawn


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


def upright(vertices: Any) -> np.ndarray:
    """Places with y upwards, turned so that z is upwards for the viewer."""
    v = floats(vertices)
    return np.stack([v[:, 0], -v[:, 2], v[:, 1]], axis=1)


def shaded(axes: Any, frame: Mapping[str, Any], extent: float, turn: bool = False, middle: Any = None) -> None:
    """A lit surface, its middle (or the given one) in the middle of the panel."""
    lit(axes, upright(vertices_of(frame)) if turn else vertices_of(frame), facets_of(frame), extent, middle)


def lit(axes: Any, vertices: np.ndarray, facets: np.ndarray, extent: float, middle: Any = None) -> None:
    """A lit surface, its middle (or the given one) in the middle of the panel."""
    v = vertices - (vertices.mean(0) if middle is None else middle)
    drawing.show_image(axes, drawing.surface_picture(v, facets, WATER, VIEW, extent, 420), extent)


def ledger_lines(axes: Any, series: Mapping[str, Any], names: Any = LEDGER) -> None:
    """Energies over time."""
    for name, words, colour in names:
        wide = 2.2 if name == "energy" else 1.4
        axes.plot(series["time"], series[name], color=colour, label=words, linewidth=wide)
    axes.set_xlabel("time [s]")
    axes.grid(axis="y")
    axes.legend(ncols=2, loc="center right")


def chosen(series: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Some of a ledger's series, with its time."""
    return {name: series[name] for name in ("time", *names)}


ENERGIES = ("energy", "surface", "kinetic", "bulk")


# Runs whose surfaces are shown over time
SURFACES = {  # the left half of the picture, then the right one
    "square_cluster": "square, 20 h", "swing_2d_16": "ellipse, R = 16 h",
    "rest_2d_11_default_0": "disc, R = 11 h", "collision_2d": "two discs, R = 8 h",
    "cube": "cube, 10 h", "swing_3d_6": "spheroid, R = 6.2 h", "floor_2d_60": "floor, 60 degrees",
    "floor_2d_120": "floor, 120 degrees",
}  # fmt: skip


def outline(axes: Any, frame: Mapping[str, Any], colour: str) -> None:
    """A reconstructed outline in the plane, in cells."""
    corner = vertices_of(frame)[facets_of(frame)][:, :, :2]
    axes.add_collection(LineCollection(corner, colors=colour, linewidths=1.2, capstyle="round"))


def surfaces_data(results: Results) -> dict[str, Any]:
    """Reconstructed surfaces of each scene at four times."""
    rows = []
    for key, words in SURFACES.items():
        values = results[key].values
        times = values["shown"]
        rows.append({"words": words, "floor": key.startswith("floor"), "space": "vertices_0" in results[key].arrays
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
            places = [upright(vertices_of(f)) if row["floor"] else vertices_of(f) for f in row["frames"]]
            if row["space"]:  # seen from any side
                extent = 1.02 * max(np.linalg.norm(p - middle_of(p), axis=1).max() for p in places)
            else:
                extent = 1.08 * max(np.abs(p - middle_of(p)).max() for p in places)
            for k, (axes, frame, place) in enumerate(zip(line, row["frames"], places)):
                middle = middle_of(place)
                if row["space"]:
                    shaded(axes, frame, extent, turn=row["floor"], middle=middle)
                else:
                    outline(axes, frame, BLUE)
                    middle = middle_of(vertices_of(frame))
                    axes.set(xlim=(middle[0] - extent, middle[0] + extent))
                    axes.set(ylim=(middle[1] - extent, middle[1] + extent), aspect="equal")
                    if row["floor"]:
                        axes.axhline(0.0, color=GREY, linewidth=0.8)
                words = f"{row['times'][k]:.3g} s"
                drawing.plain_title(axes, f"{row['words']}: {words}" if k == 0 else words, fontsize=8)
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


DROPS = tuple(f"fine_{key}" for key in fine_runs.RUNS)  # runs at twice the resolution
LEVEL = 0.02  # cells: rounding of the distances
BAND = 0.76  # cells, beyond which they are cut off: more than between two nodes
BODIES = {"collision": "collision", "merging": "merging", "floor": "on a floor, {angle} degrees"}


def drops_data(results: Results) -> dict[str, Any]:
    """Distances from the smooth surfaces of drops in space."""
    rows = []
    for key in DROPS:
        result, asked = results[key], fine_runs.RUNS[key.removeprefix("fine_")]
        frames = []
        for k in range(len(asked["shown"])):
            distance = np.clip(fine_runs.UNIT * result.arrays[f"distance_{k}"].astype(float), -BAND, BAND) / LEVEL
            packed_distance = packed(distance.round().astype(np.int8).reshape(-1))
            first = result.arrays[f"first_{k}"].tolist()
            frames.append({"first": first, "shape": list(distance.shape), "distance": packed_distance})
        words = BODIES[asked["body"]].format(**asked)
        rows.append({"words": words, "floor": asked["body"] == "floor", "times": asked["shown"], "frames": frames,
                     "particles": result.values["particles"]})  # fmt: skip
    return {"title": "Drops that meet, merge and stand on floors", "rows": rows}


def smooth_surface(frame: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """(vertices [cells], triangles) of the surface of a frame."""
    values = LEVEL * unpacked(frame["distance"], "int8").astype(float).reshape(frame["shape"])
    vertices, facets = contour(values)
    return fine_runs.NODE * (vertices + np.array(frame["first"])), facets


def largest_part(vertices: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """The facets of the part of a surface that has the most of them."""
    edges = np.concatenate([facets[:, :2], facets[:, 1:]])
    joined = coo_matrix((np.ones(len(edges)), edges.T), shape=(len(vertices), len(vertices)))
    part = connected_components(joined, directed=False)[1][facets[:, 0]]
    return facets[part == np.bincount(part).argmax()]


def drops_picture(data: Mapping[str, Any]) -> Any:
    """A row for each body, time from left to right; on floors without the single particles beside the drop."""
    count = max(len(row["frames"]) for row in data["rows"])
    figure = plt.figure(figsize=(7.2, 1.5 * len(data["rows"])))
    for part, row in zip(np.ravel(figure.subfigures(len(data["rows"]), 1)), data["rows"]):
        drawing.headline(part, row["words"], 9.5)
        line = part.subplots(1, count)
        bodies = [smooth_surface(frame) for frame in row["frames"]]
        if row["floor"]:
            bodies = [(vertices, largest_part(vertices, facets)) for vertices, facets in bodies]
        seen = [vertices[np.unique(facets)] for vertices, facets in bodies]
        extent = 1.02 * max(np.abs(vertices - middle_of(vertices)).max() for vertices in seen)
        for axes in line:
            axes.set_axis_off()
        for axes, at, (vertices, facets), own in zip(line, row["times"], bodies, seen):
            middle = middle_of(own)
            if row["floor"]:  # the floor stands still
                middle[1] = 0.4 * extent
            lit(axes, upright(vertices), facets, extent, upright(middle[None])[0])
            drawing.plain_title(axes, f"{at:g} s", fontsize=9)
    return figure


def pressure_data(results: Results) -> dict[str, Any]:
    """Pressures at rest against resolution."""

    found = pressures(results)
    return {
        "title": "Pressure of drops at rest over Laplace's",
        "curves": {f"{dim}d_{name}": {"rows": rows, "orders": orders(rows)} for (dim, name), rows in found.items()},
    }


def pressure_picture(data: Mapping[str, Any]) -> Any:
    """The plane on the left, space on the right."""
    figure, panels = plt.subplots(1, 2, figsize=(9.0, 3.3), sharey=True)
    for axes, dim, bar, place in ((panels[0], 2, 0.03, 11.0), (panels[1], 3, 0.05, 6.0)):
        axes.axhline(1.0, color=GREY, linewidth=0.8)
        axes.plot([place, place], [1 - bar, 1 + bar], color=GREY, linewidth=5, alpha=0.35, solid_capstyle="butt")
        for name, words, colour in (("default", "inset h/4", ORANGE), ("enclosing", "inset by volume", BLUE)):
            curve = data["curves"].get(f"{dim}d_{name}")
            if curve is None:
                continue
            x, y = ([row[key] for row in curve["rows"]] for key in ("cells", "pressure"))
            half = [0.5 * row["spread"] for row in curve["rows"]]
            gains = ", ".join(f"{gain:.2f} ({small:g} to {2 * small:g})" for small, gain in curve["orders"])
            label = f"{words}; order {gains}" if gains else words
            axes.errorbar(x, y, half, color=colour, marker="o", markersize=4, capsize=3, label=label)
        axes.set_xscale("log", base=2)
        axes.set_xlabel("R/h")
        axes.set_xticks([row["cells"] for row in curve["rows"]], [f"{row['cells']:.3g}" for row in curve["rows"]])
        axes.minorticks_off()
        axes.set_title("in the plane" if dim == 2 else "in space")
        axes.grid(axis="y")
        axes.legend(loc="lower right" if dim == 3 else "upper right", fontsize=7.5)
    panels[0].set(ylim=(0.932, 1.058), ylabel="pressure over k (d - 1)/R")
    return figure


def frequency_data(results: Results) -> dict[str, Any]:
    """Frequencies against resolution and amplitude, and what shifts them."""
    names = ("dim", "radius_in_cells", "amplitude", "ratio", "ratio_error", "inertia", "compressible",
             "damping_of_period")  # fmt: skip
    swings = {key: result.values for key, result in results.items() if key.startswith("swing_")}
    rows = {key.removeprefix("swing_"): {name: values[name] for name in names} for key, values in swings.items()}
    flows = {dim: results[f"potential_flow_{dim}"].values for dim in ("2d", "3d")}
    ideal = {dim: {name: flow[name] for name in ("amplitudes", "ratios")} for dim, flow in flows.items()}
    one = {name: swings["swing_2d_16"][own] for name, own in (("swing", "swing"), ("radius", "radius_in_cells"))}
    return {"title": "Mode 2 against Rayleigh's frequency", "rows": rows, "ideal": ideal, **one}


def frequency_picture(data: Mapping[str, Any]) -> Any:
    """The swing itself, then the frequency over amplitude and over resolution, with all that is known to shift it."""
    figure, (swing, amplitude, resolution) = plt.subplots(1, 3, figsize=(11.4, 3.9), width_ratios=(1, 1.15, 1.25))
    swing.plot(data["swing"]["time"], data["swing"]["value"], color=BLUE)
    swing.set(xlabel="time [s]", ylabel=r"$\langle x^2-y^2\rangle/\langle x^2+y^2\rangle$")
    swing.set(title="Mode 2, in the plane, R = 16 h, 10 %")
    kinds = (("2d", "in the plane", BLUE, "2d_16"), ("3d", "in space", ORANGE, "3d_9"))
    for dim, words, colour, series in kinds:
        rows = {key: r for key, r in data["rows"].items() if key.startswith(dim)}
        share, ratio = (floats(data["ideal"][dim][name]) for name in ("amplitudes", "ratios"))
        found = sorted((r for k, r in rows.items() if k.startswith(series)), key=lambda r: r["amplitude"])
        amplitude.plot(100 * share, ratio, color=colour, linewidth=0.9, alpha=0.7)
        amplitude.plot(100 * share, known(found[0]) * ratio, "--", color=colour, linewidth=0.9)
        marked(amplitude, [100 * r["amplitude"] for r in found], found, colour, f"{words}, R = {series[3:]} h")
        found = sorted((r for k, r in rows.items() if k.removeprefix(f"{dim}_").replace(".", "").isdigit()),
                       key=lambda r: r["radius_in_cells"])  # fmt: skip
        exact = dict(zip(share, ratio))[0.1]
        x = [r["radius_in_cells"] for r in found]
        resolution.axhline(exact, color=colour, linewidth=0.9, alpha=0.7)
        resolution.plot(x, [exact * known(r) for r in found], "--", color=colour, linewidth=0.9)
        marked(resolution, x, found, colour, words)
    amplitude.set_xlim(left=0)
    amplitude.set(xlabel="amplitude [%]", ylabel=r"$\omega/\omega_R$", title="Amplitude")
    resolution.set_xscale("log", base=2)
    ticks = (4, 6, 8, 11, 16, 22)
    resolution.set_xticks(ticks, [f"{v:d}" for v in ticks])
    resolution.minorticks_off()
    resolution.set(xlabel="R/h", title="Resolution, amplitude 10 %")
    for axes in (amplitude, resolution):
        axes.plot([], [], color=GREY, linewidth=0.9, label="ideal liquid")
        axes.plot([], [], "--", color=GREY, linewidth=0.9, label="... compressible, with the grid's inertia")
        axes.axhspan(0.97, 1.03, color=GREY, alpha=0.12, linewidth=0)
        axes.set_ylim(0.935, 1.035)
        axes.legend(fontsize=7.5, loc="upper right")
    for axes in (swing, amplitude, resolution):
        axes.grid(axis="y")
    return figure


def known(row: Mapping[str, Any]) -> float:
    """What compressibility and the grid's inertia do to the frequency of ideal liquid."""
    return float(row["compressible"] / math.sqrt(real(row["inertia"])))


def marked(axes: Any, x: Any, rows: Any, colour: str, words: str) -> None:
    """Measured frequencies with the fit's standard error."""
    axes.errorbar(x, [r["ratio"] for r in rows], [r["ratio_error"] for r in rows], color=colour, marker="o",
                  markersize=4, capsize=2, label=words)  # fmt: skip


PICTURES = (
    Picture("mpm_square", square_data, square_picture, ("square_cluster",)),
    Picture("mpm_surfaces", surfaces_data, surfaces_picture, tuple(SURFACES), shaded=True),
    Picture("mpm_box", box_data, box_picture, ("box", "box_default")),
    Picture("mpm_drops", drops_data, drops_picture, DROPS, shaded=True),
    Picture("mpm_pressure", pressure_data, pressure_picture, ("rest_2d_22_enclosing_0",)),
    Picture("mpm_frequency", frequency_data, frequency_picture,
            ("swing_2d_22", "swing_3d_9", "potential_flow_2d", "potential_flow_3d")),
)  # fmt: skip
