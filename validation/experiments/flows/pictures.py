"""Pressures of water that falls onto sensors, beside the experiments'."""

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt

from validation.drawing import BLACK, BLUE, GREEN, ORANGE
from validation.experiment import Picture, Results
from validation.experiments.flows.runs import FALLS, measured

TITLES = {"lobovsky": "Lobovský et al. 2014", "spheric_2": "SPHERIC 2"}


def data(results: Results) -> dict[str, Any]:
    """Series of each sensor, measured and by the number of particles; arrivals and means."""
    parts: dict[str, Any] = {}
    for flow, fall in FALLS.items():
        if "series" not in fall:
            continue
        runs = {r.values["cells"]: r for r in results.values() if r.values["kind"] == flow}
        for name, series in measured(fall).items():
            lines = {
                str(cells): [[round(float(x), 3) for x in run.arrays[part]] for part in ("time", name)]
                for cells, run in sorted(runs.items())
            }
            values = {str(cells): run.values[name] for cells, run in sorted(runs.items())}
            if lines:
                known = [column.tolist() for column in series]
                parts[f"{flow} {name}"] = {"measured": known, "lines": lines, "values": values}
    return parts


def picture(data: Mapping[str, Any]) -> Any:
    """A part for each sensor."""
    figure, axes = plt.subplots(1, len(data), figsize=(3.0 * len(data), 3.6), squeeze=False)
    for place, (title, part) in zip(axes[0], data.items()):
        flow, name = title.split()
        for (cells, (time, pressure)), colour in zip(part["lines"].items(), (ORANGE, GREEN, BLUE)):
            place.plot(time, pressure, color=colour, lw=0.9, label=f"{cells} particles high")
        place.plot(*part["measured"], "o", color=BLACK, ms=2.2, label="measured")
        place.set(title=f"{TITLES[flow]}, {name}", xlabel="t sqrt(g/H)", ylim=(-0.3, 3.2))
        if title in ("lobovsky P4", "spheric_2 P3"):  # where there is room
            place.legend(loc="upper right", fontsize=6)
        place.grid(True)
    axes[0][0].set_ylabel("pressure over rho g H")
    return figure


SHOWN = tuple(f"{flow}_{cells}" for flow, fall in FALLS.items() if "series" in fall for cells in fall["cells"])
PICTURES = (Picture("impacts", data, picture, needs=SHOWN),)
