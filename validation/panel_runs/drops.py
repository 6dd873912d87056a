"""Runs of panels without a packaged scene: drops that are stirred first.

Each measures settings in turn, as `validation.accuracy` asks for them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

from refsim import calibrate_contact_angle
from refsim.surface_tension.calibration import sigma_map
from validation.measure import drops, wetting
from validation.running import Context
from validation.turns import Outcome, panel

SEED = 10  # of the first repeat of a drop: the maps hold seeds 1 to 3
ANGLE = 90.0  # requested [degrees]


def flat_tension(model: str) -> tuple[float, float]:
    """Tension of a flat surface over the nominal one in 2D, and its standard error, from the map's pressure jumps."""
    entry = next(e for e in sigma_map() if e["model"] == model and e["dim"] == 2 and drops.at_base(model, e))
    return entry["flat_laplace"], entry["flat_laplace_error"]


def drop(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """A drop of its own seed: R P over the flat tension, or its frequency over Lamb's with the flat tension."""
    by, model, knobs = setting["by"], setting["model"], setting["knobs"]
    point = drops.Point(
        model, 2, radius=setting["radius"], seed=SEED + repeat, kicked=by == "rayleigh", backend=knobs["backend"],
        dtype=knobs["dtype"], **drops.base(model),
    )  # fmt: skip
    began = time.perf_counter()
    row = drops.measure(point)
    spent = time.perf_counter() - began
    if row["stopped"]:
        return Outcome(seconds=spent, particles=row.get("particles", 0), stopped=row["stopped"])
    share = row[by] / flat_tension(model)[0]
    value = math.sqrt(max(share, 0.0)) if by == "rayleigh" else share
    return Outcome(value, spent, row["steps"], row["particles"])


tensions = panel(drop, lambda context, setting: drop(context, {**setting, "radius": 4.0}, 0))


def _sessile(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """A drop of its own seed on a plane, stirred, at rest and observed: its angle [degrees]."""
    found = calibrate_contact_angle(ANGLE, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    began = time.perf_counter()
    point = wetting.Point(found.share, 2, radius=setting["radius"], seed=SEED + repeat)
    row = wetting.measure(point, setting["knobs"]["backend"])
    spent = time.perf_counter() - began
    if row["stopped"] or row["fate"] != "cap":
        stopped = row["stopped"] or f"{row['fate']}: no cap"
        return Outcome(seconds=spent, particles=row.get("particles", 0), stopped=stopped)
    return Outcome(row["angle"], spent, row["steps"], row["particles"])


angles = panel(_sessile, lambda context, setting: wetting.measure(wetting.Point(12.0, 2, radius=3.0)))
