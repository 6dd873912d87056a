"""What known failures look like: a panel each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from validation.drawing import BLACK, BLUE, GREY, VERMILION
from validation.experiment import Picture, Results
from validation.results import floats

TITLES = {
    "impact": "impact_wall:\npressed onto the wall", "edge_wedge": "edge_wedge:\nspray inside the wall",
    "edge_level_plate": "edge_level_plate:\nspray through the plate",
    "upright_edges": "beside_walls_3d_number_density,\nseen from above",
    "sheet": "sheet_1_*:\ninner particles are missed", "filament": "filament:\nends draw in, no drops",
    "rounding": "heat_s_max_1e7:\nrounding of 19,000 stages",
}  # fmt: skip
SEEN = {"impact": (0, 2), "edge_wedge": (0, 1), "edge_level_plate": (0, 1), "upright_edges": (0, 2), "sheet": (0, 2),
        "filament": (2, 0)}  # axes to the right and upwards  # fmt: skip


def data(results: Results) -> dict[str, Any]:
    """Places in spacings, who is wrong, and the change of heat by scheme."""
    made: dict[str, Any] = {"title": "Known failures"}
    for key, axes in SEEN.items():
        arrays = results[key].arrays
        made[key] = {
            "place": arrays["position"][:, axes].round(2).tolist(),
            "wrong": np.flatnonzero(arrays.get("wrong", ())).tolist(),
        }
        if "walls" in arrays:
            made[key]["walls"] = arrays["walls"][:, axes].round(2).tolist()
    checks = results["rounding"].values["checks"]
    made["rounding"] = {
        name: [found["value"], found["bound"]] for name, found in checks.items() if name.endswith("heat")
    }
    return made


def picture(found: Mapping[str, Any]) -> Any:
    """Particles from the side or from above, the wrong ones in red; bars for heat."""
    figure, panels = plt.subplots(2, 4, figsize=(12.0, 5.2), layout="constrained")
    for axes, (key, title) in zip(panels.flat, TITLES.items()):
        axes.set_title(title, fontsize=8)
        if key == "rounding":
            _bars(axes, found[key])
            continue
        place, wrong = floats(found[key]["place"]), np.array(found[key]["wrong"], int)
        right = np.setdiff1d(np.arange(len(place)), wrong)
        size = 2.0 if len(place) > 2000 else 5.0
        axes.scatter(*place[right].T, s=size, color=BLUE, linewidths=0)
        axes.scatter(*place[wrong].T, s=3 * size, color=VERMILION, linewidths=0)
        if "walls" in found[key]:
            axes.plot(*floats(found[key]["walls"]).T, ".", color=BLACK, markersize=1.5)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel(f"[d]; wrong: {len(wrong)} of {len(place):,}" if key != "filament" else "[d]")
    panels.flat[-1].set_axis_off()
    return figure


def _bars(axes: Any, checks: Mapping[str, Any]) -> None:
    values = {name.partition(":")[0].replace("_", " "): max(pair[0], 1e-17) for name, pair in checks.items()}
    bound = max(pair[1] for pair in checks.values())
    names = list(values)
    axes.barh(names, list(values.values()), color=[VERMILION if v > bound else BLUE for v in values.values()])
    axes.axvline(bound, color=GREY, linewidth=0.8)
    axes.set_xscale("log")
    axes.tick_params(axis="y", labelsize=6)
    axes.set_xlabel("change of heat over heat; line: bar")


FAILURES_PICTURES = (Picture("known_failures", data, picture, tuple(TITLES)),)
