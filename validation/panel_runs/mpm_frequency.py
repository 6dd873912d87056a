"""What the accuracy panel of swinging MPM drops measures: the frequency of mode 2 against wall time."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.core.errors import RunStopped
from validation.experiments.mpm_droplet import runs
from validation.experiments.mpm_droplet.scene import CELLS, MODULUS, drop_scene, ellipsoid, radius_of
from validation.results import Result
from validation.running import Context, first_call_seconds, with_step
from validation.turns import Outcome, in_turns

RADIUS = 11.0 * CELLS[2]  # of every disc [m]
AMPLITUDE = 0.05  # of its radius
PERIODS = 2.0


def swung(context: Context, setting: Mapping[str, Any], repeat: int, periods: float = PERIODS) -> Outcome:
    """Frequency of an ellipse that swings, cut from a lattice turned by `repeat`, over Rayleigh's."""
    knobs = setting["knobs"]
    place = ellipsoid(setting["radius"], 2, AMPLITUDE, seed=repeat)
    cell = RADIUS / setting["radius"]
    scene = drop_scene(place, 2, cell=cell, tension=setting["tension"], liquid={"bulk_modulus": MODULUS},
                       balanced=True, dtype=knobs["dtype"], step=0.0)  # fmt: skip
    run = context.simulation(with_step(context, scene, knobs["step"], knobs["backend"]), knobs["backend"])
    known = runs.rayleigh(cell * radius_of(len(place), 2), 2)
    until = periods * 2 * math.pi / known
    times, values, wall, stopped = [], [], 0.0, ""
    try:
        while run.time < until:
            began = time.perf_counter()
            run.step()
            run.backend.synchronize()
            wall += time.perf_counter() - began
            if run.steps % 4 == 0:
                times.append(run.time)
                values.append(runs.deformation(run.field("position"), 2))
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
    share = math.nan
    if not stopped and len(times) > 8:
        share = runs.damped_cosine(np.array(times), np.array(values), known)["frequency"] / known
    return Outcome(
        share, abs(share - 1), wall - first_call_seconds(run), run.steps, run.count, stopped,
        launches=len(run.plan.launches()), bytes=sum(run.plan.field_bytes().values()),
    )  # fmt: skip


def frequencies(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn, each repeat with a lattice turned otherwise."""
    for setting in settings.values():  # compiles
        swung(context, setting, 0, periods=0.02)
    return in_turns(context, settings, swung, threads, repeats, backend)
