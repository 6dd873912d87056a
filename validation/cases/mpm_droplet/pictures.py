"""Pictures of the MPM droplet."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from refsim.mpm import READINGS
from validation.drawing import BLUE, GREEN, GREY, ORANGE, VERMILION
from validation.harness import Results

COLOURS = {"none": GREY, "cluster": BLUE, "thesis": VERMILION, "gradient_corrected": ORANGE}
FLOOR = 1e-17  # where an error that is exactly zero is drawn


def square_data(results: Results) -> dict[str, Any]:
    """Particles at four times, and energies over time."""
    result = results["square_cluster"]
    return {
        "title": "A square of liquid becomes a disc",
        "frames": result.arrays["frames"][:, :, :2].round(5).tolist(),
        "times": result.values["frames"],
        "series": result.values["series"],
        "until": result.values["series"]["time"][-1],
    }


def square_picture(data: Mapping[str, Any]) -> Any:
    """Four frames above, the energy ledger below."""
    import matplotlib.pyplot as plt

    figure, places = plt.subplot_mosaic(
        [["0", "1", "2", "3"], ["energy"] * 4], figsize=(8.6, 5.4), height_ratios=(1, 1.2), layout="constrained"
    )
    points = [point for frame in data["frames"] for point in frame]
    margin = 0.01
    low_high = [(min(p[c] for p in points) - margin, max(p[c] for p in points) + margin) for c in range(2)]
    for k, (at, frame) in enumerate(zip(data["times"], data["frames"])):
        axes = places[str(k)]
        axes.scatter([x for x, _ in frame], [y for _, y in frame], s=1.6, color=BLUE, linewidths=0)
        axes.set_aspect("equal")
        axes.set_xlim(*low_high[0])
        axes.set_ylim(*low_high[1])
        axes.set_title(f"{at:g} s")
        axes.set_xticks([])
        axes.set_yticks([])
        axes.grid(False)
    series, axes = data["series"], places["energy"]
    parts = (
        ("energy", "all", GREY),
        ("surface", "surface", VERMILION),
        ("kinetic", "motion", BLUE),
        ("bulk", "bulk", GREEN),
    )
    for name, words, colour in parts:
        axes.plot(series["time"], series[name], color=colour, label=words, linewidth=2.2 if name == "energy" else 1.4)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("energy [J/m]")
    axes.set_ylim(bottom=0)
    axes.set_xlim(0, data["until"])
    axes.legend(frameon=False, ncols=4, loc="center right")
    axes.grid(axis="y")
    axes.set_title("energy ledger")
    return figure


def readings_data(results: Results) -> dict[str, Any]:
    """Errors of the four readings."""
    return {"title": "What the readings keep", "readings": results["transfers"].values["readings"]}


def readings_picture(data: Mapping[str, Any]) -> Any:
    """Errors side by side on a logarithmic axis."""
    import matplotlib.pyplot as plt

    parts = {"grid_momentum": "momentum\non the grid", "momentum": "momentum\nthere and back", "velocity": "velocity",
             "gradient": "gradient A\nat the surface", "power": "power\nbalance"}  # fmt: skip
    figure, axes = plt.subplots(figsize=(8.6, 3.8), layout="constrained")
    for k, name in enumerate(READINGS):
        found = data["readings"][name]
        errors = [abs(found[p] - 1) if p == "power" else found[p] for p in parts]
        place = [i + 0.2 * (k - 1.5) for i in range(len(parts))]
        axes.bar(place, [max(e, FLOOR) for e in errors], width=0.18, color=COLOURS[name], label=name.replace("_", " "))
    axes.set_yscale("log")
    axes.set_ylim(FLOOR, 30)
    axes.set_xticks(range(len(parts)), parts.values())
    axes.set_ylabel("relative error")
    axes.grid(axis="y")
    axes.legend(frameon=False, ncols=4, loc="upper left")
    axes.set_title("Affine field to the grid and back: four readings of the embedding", pad=12)
    return figure
