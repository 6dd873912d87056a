"""Pictures of the droplet, each drawn from its own data file."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize

from validation import drawing
from validation.drawing import BLUE, GREY, ORANGE, SKY, VERMILION, WATER
from validation.experiment import Picture, Results
from validation.metrics.droplet import surface_mesh
from validation.results import floats

VIEW = drawing.view_matrix(azimuth=32.0, elevation=24.0)
ROWS = {"cube_4913": "cube", "cut_5039": "cube cut from a turned lattice", "box_4862": "turned box, 1.3 : 1 : 0.8"}
SURFACE_ONLY = {  # "tension acts on surface particles only", as the paper's text and as its words alone have it
    "mode_text": "cube, the paper's text: pairs of its surface set",
    "mode_one_sided": "cube, the paper's words: force on surface particles only",
}
EXTENT = 1.5  # half width of a frame, in R


def chosen_frames(values: Mapping[str, Any], count: int) -> list[int]:
    """Samples shown: the start, the first octahedron (greatest q4), one half-way to it, and later ones to the end."""
    moment = floats(values["series"]["cubic_moment"])
    last = len(moment) - 1
    peak = int(np.argmax(moment[: last // 2]))
    way = int(np.argmin(np.abs(moment[: peak + 1] - 0.5 * moment[0]))) if peak > 1 else 1
    chosen = [0, way, peak]
    chosen += np.geomspace(last, max(2 * peak, 2), max(count - 3, 1)).round().astype(int).tolist()
    return sorted({k for k in chosen if k <= last})


def frame_data(results: Results) -> dict[str, Any]:
    """Figure 6: the particles of each start at chosen times."""
    title = "Figure 6: a cube of liquid becomes a drop"
    data: dict[str, Any] = {"title": title, "half_width_radii": EXTENT, "rows": []}
    for key, label in (ROWS | SURFACE_ONLY).items():
        if key not in results or key == "cut_5039":
            continue
        values, position = results[key].values, results[key].arrays["position"]
        frames = []
        for k in chosen_frames(values, 6):
            x = (position[k] - position[k].mean(0)) / values["radius"]
            series = values["series"]
            frames.append({
                "time_s": series["time"][k], "cubic_moment": series["cubic_moment"][k],
                "radius_variation": series["radius_variation"][k],
                "position_milliradii": drawing.thousandths(x),
            })  # fmt: skip
        data["rows"].append({
            "start": label, "particles": values["particles"], "radius_m": values["radius"],
            "capillary_time_s": values["capillary_time"], "spacing_radii": values["spacing"] / values["radius"],
            "frames": frames,
        })  # fmt: skip
    return data


def frame_picture(data: Mapping[str, Any]) -> Any:
    """Rows of lit balls, coloured by their distance from the centre."""
    rows = data["rows"]
    columns = max(len(row["frames"]) for row in rows)
    figure, panels = plt.subplots(len(rows), columns, figsize=(1.75 * columns, 2.55 * len(rows) + 0.75), squeeze=False)
    norm, colours = Normalize(0.8, 1.3), plt.get_cmap("viridis")
    extent = data["half_width_radii"]
    for row, line in zip(rows, panels):
        for axes in line:
            axes.set_axis_off()
        for frame, axes in zip(row["frames"], line):
            x = np.array(frame["position_milliradii"]) / 1000
            colour = colours(norm(np.linalg.norm(x, axis=1)))[:, :3]
            drawing.show_balls(axes, x, row["spacing_radii"], colour, VIEW, extent, 320)
            drawing.plain_title(axes, f"t = {frame['time_s'] / row['capillary_time_s']:.2f}")
            drawing.caption(axes, f"$q_4$ = {frame['cubic_moment']:+.3f}\nroughness {frame['radius_variation']:.4f}")
        title = f"{row['start'].capitalize()}, {row['particles']:,} particles"
        line[0].set_title(" \n ", loc="left")  # space for the words, whose width must not push the next frame away
        line[0].text(0, 1.2, title, transform=line[0].transAxes, fontweight="bold").set_in_layout(False)
    bar = figure.colorbar(
        ScalarMappable(norm, colours), ax=panels, orientation="horizontal", shrink=0.4, aspect=40, pad=0.02
    )
    bar.set_label(r"distance from the centre / R   (times in $\sqrt{\rho R^3/\sigma}$, roughness is std/mean radius)")
    return figure


def surface_data(results: Results) -> dict[str, Any]:
    """Figure 7: all particles at four times; the surface is made of them when it is drawn."""
    values, position = results["cube_4913"].values, results["cube_4913"].arrays["position"]
    frames = []
    for k in chosen_frames(values, 4):
        x = (position[k] - position[k].mean(0)) / values["radius"]
        frames.append(
            {"time_s": values["series"]["time"][k], "position_milliradii": np.rint(1000 * x).astype(int).tolist()}
        )
    return {
        "title": "Figure 7: the drop's surface", "spacing_radii": values["spacing"] / values["radius"],
        "capillary_time_s": values["capillary_time"], "half_width_radii": 1.4, "frames": frames,
    }  # fmt: skip


def surface_picture_of(data: Mapping[str, Any]) -> Any:
    """The reconstructed surface, lit."""
    frames, extent = data["frames"], data["half_width_radii"]
    figure, panels = plt.subplots(1, len(frames), figsize=(2.5 * len(frames), 3.0))
    for frame, axes in zip(frames, np.atleast_1d(panels)):
        x = np.array(frame["position_milliradii"]) / 1000
        x = x[np.linalg.norm(x, axis=1) < 3.0]
        mesh = surface_mesh(x, data["spacing_radii"], smoothing=1.0, cell=0.3)
        drawing.show_image(axes, drawing.surface_picture(*mesh, WATER, VIEW, extent, pixels=480), extent)
        drawing.plain_title(axes, f"t = {frame['time_s'] / data['capillary_time_s']:.2f}", y=0.95)
    figure.supxlabel(r"times in $\sqrt{\rho R^3/\sigma}$; surface where half the volume is liquid", fontsize=8.5)
    return figure


def force_data(results: Results) -> dict[str, Any]:
    """Figure 2: the curve of J(17), in units of W_poly6(0, h), with the printed and the adopted 2D coefficient."""
    from refsim.surface_tension.jiang_zhu_2023 import ALPHA, BETA, INNER

    q = np.linspace(0.0, 1.05, 211)

    def curve(alpha: float, dim: int) -> np.ndarray:
        def poly6(u: np.ndarray) -> np.ndarray:
            return np.where(u < 1, (1 - np.minimum(u, 1.0) ** 2) ** 3, 0.0)

        return alpha * poly6(q / INNER) / INNER**dim - BETA * poly6(q)

    return {
        "title": "Figure 2: inter-particle force, J(17)",
        "q": q.round(4),
        "curves": {
            "3D, alpha = 0.6, beta = 0.9 (the paper)": curve(ALPHA[3], 3).round(5),
            "2D, alpha = 0.75 (adopted: the same shape)": curve(ALPHA[2], 2).round(5),
            "2D, alpha = 0.6 (printed)": curve(ALPHA[3], 2).round(5),
        },
    }


def force_picture(data: Mapping[str, Any]) -> Any:
    """Repulsion up, attraction down, zeros marked."""
    figure, axes = plt.subplots(figsize=(6.4, 3.8))
    q = np.array(data["q"])
    looks = ((VERMILION, "-", 2.4), (BLUE, "--", 1.6), (GREY, ":", 1.8))
    for (label, values), (colour, dash, width) in zip(data["curves"].items(), looks):
        c = np.array(values)
        axes.plot(q, c, dash, color=colour, lw=width, label=label)
        cross = int(np.flatnonzero((c[:-1] > 0) & (c[1:] <= 0))[0])
        zero = q[cross] + (q[cross + 1] - q[cross]) * c[cross] / (c[cross] - c[cross + 1])
        axes.plot(zero, 0, "o", ms=6, mfc="white", mec=colour, mew=1.5, zorder=4)
        if dash != "--":
            place = (zero + 0.06, 0.085) if dash == "-" else (0.03, -0.075)
            axes.annotate(
                f"zero at {zero:.3f} h", (zero, 0), place, fontsize=8.5,
                color=colour, arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.8},
            )  # fmt: skip
    axes.axhline(0, color="#444444", lw=0.8)
    low, high = axes.get_ylim()
    axes.axhspan(0, high, color=ORANGE, alpha=0.06, lw=0)
    axes.axhspan(low, 0, color=SKY, alpha=0.08, lw=0)
    axes.set_ylim(low, high)
    axes.text(1.03, 0.012, "repulsion", ha="right", fontsize=9, color=GREY)
    axes.text(1.03, -0.022, "attraction", ha="right", fontsize=9, color=GREY)
    axes.set(xlim=(0, 1.05), xlabel="distance r / h", ylabel=r"$C(r)\,/\,W_{\mathrm{poly6}}(0,h)$")
    axes.set(title="Inter-particle force of Jiang & Zhu 2023, J(17)")
    axes.grid(True)
    axes.legend(loc="upper right")
    return figure


PICTURES = (
    Picture("figure_2_force_curve", force_data, force_picture),
    Picture("figure_6", frame_data, frame_picture, ("cube_4913",), shaded=True),
    Picture("figure_7", surface_data, surface_picture_of, ("cube_4913",)),
)
