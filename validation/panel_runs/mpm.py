"""What the accuracy panels of MPM drops measure: the pressure of a disc at rest, and the frequency of mode 2."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim import Simulation
from refsim.core.errors import RunStopped
from validation.experiments.mpm_droplet import runs
from validation.experiments.mpm_droplet.scene import CELLS, MODULUS, drop_scene, ellipsoid, radius_of
from validation.running import Context, first_call_seconds, with_step
from validation.turns import Outcome, distribution, panel, stepped

RADIUS = 11.0 * CELLS[2]  # of every disc [m]
UNTIL = 0.12  # s, of a disc at rest
BEGIN = 0.25  # share of the run after which pressures count
AMPLITUDE = 0.05  # of the radius of what swings
PERIODS = 2.0


def disc(context: Context, setting: Mapping[str, Any], seed: int, stretch: float = 0.0) -> tuple[Simulation, float]:
    """(a disc or an ellipse longer by `stretch`, cut from a lattice turned by `seed`; its mean radius [m])."""
    knobs = setting["knobs"]
    place = ellipsoid(setting["radius"], 2, stretch, seed=seed)
    cell = RADIUS / setting["radius"]
    scene = drop_scene(place, 2, cell=cell, tension=setting["tension"], liquid={"bulk_modulus": MODULUS},
                       balanced=True, dtype=knobs["dtype"], step=0.0)  # fmt: skip
    scene = with_step(context, scene, knobs["step"], knobs["backend"])
    return context.simulation(scene, knobs["backend"]), cell * radius_of(len(place), 2)


def _followed(run: Simulation, until: float, look: Callable[[], None]) -> tuple[float, str]:
    """(wall seconds of stepping to `until` [s], why the run stopped or ""); `look` is called after each step."""
    wall = 0.0
    try:
        while run.time < until:
            began = time.perf_counter()
            run.step()
            run.backend.synchronize()
            wall += time.perf_counter() - began
            look()
    except RunStopped as stop:
        return wall, f"{stop.reason} in step {run.steps}"
    return wall, ""


def held(context: Context, setting: Mapping[str, Any], seed: int, until: float = UNTIL) -> Outcome:
    """Mean pressure over Laplace's of a disc at rest to `until` [s]."""
    run, radius = disc(context, setting, seed)
    laplace = 1 / radius
    pressures: list[float] = []
    noted = 0

    def look() -> None:
        nonlocal noted
        if run.time > BEGIN * until and run.time > noted * until / 400:
            noted = int(400 * run.time / until) + 1
            ratio = run.field("volume_ratio").astype(float)
            pressures.append(-MODULUS * float(((ratio - 1) * ratio).sum() / ratio.sum()) / laplace)

    wall, stopped = _followed(run, until, look)
    ratio = run.field("volume_ratio").astype(float)
    stages = run.timings.stages
    surface = min(sum(spent for name, spent in stages.items() if name.startswith("surface_energy.")), wall)
    return stepped(
        run, float(np.mean(pressures)) if pressures else math.nan, wall, stopped,
        parts={"surface": surface, "transfers": wall - surface},
        distribution={"J against its mean": distribution(ratio - ratio.mean())},
    )  # fmt: skip


def swung(context: Context, setting: Mapping[str, Any], repeat: int, periods: float = PERIODS) -> Outcome:
    """Frequency of an ellipse that swings, cut from a lattice turned by `repeat`, over Rayleigh's."""
    run, radius = disc(context, setting, repeat, AMPLITUDE)
    known = runs.rayleigh(radius, 2)
    times, values = [], []

    def look() -> None:
        if run.steps % 4 == 0:
            times.append(run.time)
            values.append(runs.deformation(run.field("position"), 2))

    wall, stopped = _followed(run, periods * 2 * math.pi / known, look)
    share = math.nan
    if not stopped and len(times) > 8:
        share = runs.damped_cosine(np.array(times), np.array(values), known)["frequency"] / known
    return stepped(run, share, wall - first_call_seconds(run), stopped)


pressures = panel(held, lambda context, setting: held(context, setting, 0, until=0.02 * UNTIL))
frequencies = panel(swung, lambda context, setting: swung(context, setting, 0, periods=0.02))
