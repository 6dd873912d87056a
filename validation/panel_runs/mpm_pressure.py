"""What the accuracy panel of MPM drops measures: the pressure that a disc at rest holds, against wall time."""

from __future__ import annotations

import time
from collections.abc import Mapping
from operator import itemgetter
from typing import Any

import numpy as np

from refsim import Simulation
from refsim.core.errors import RunStopped
from validation.experiments.mpm_droplet.scene import CELLS, MODULUS, drop_scene, ellipsoid, radius_of
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context, first_call_seconds, with_step
from validation.turns import rounds

RADIUS = 11.0 * CELLS[2]  # of every disc [m]
UNTIL = 0.12  # s
BEGIN = 0.25  # share of the run after which pressures count


def disc(context: Context, setting: Mapping[str, Any], seed: int) -> tuple[Simulation, float]:
    """(a disc at rest, cut from a lattice turned by `seed`; its Laplace pressure [N/m])."""
    knobs = setting["knobs"]
    place = ellipsoid(setting["radius"], 2, seed=seed)
    cell = RADIUS / setting["radius"]
    scene = drop_scene(place, 2, cell=cell, tension=setting["tension"], liquid={"bulk_modulus": MODULUS},
                       balanced=True, dtype=knobs["dtype"], step=0.0)  # fmt: skip
    scene = with_step(context, scene, knobs["step"], knobs["backend"])
    return context.simulation(scene, knobs["backend"]), 1 / (cell * radius_of(len(place), 2))


def held(context: Context, setting: Mapping[str, Any], seed: int, until: float = UNTIL) -> dict[str, Any]:
    """Mean pressure over Laplace's to `until` [s], wall seconds, steps and what else one run gives."""
    run, laplace = disc(context, setting, seed)
    wall, pressures, stopped, noted = 0.0, [], "", 0
    try:
        while run.time < until:
            began = time.perf_counter()
            run.step()
            run.backend.synchronize()
            wall += time.perf_counter() - began
            if run.time > BEGIN * until and run.time > noted * until / 400:
                noted = int(400 * run.time / until) + 1
                ratio = run.field("volume_ratio").astype(float)
                pressures.append(-MODULUS * float(((ratio - 1) * ratio).sum() / ratio.sum()) / laplace)
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
    ratio = run.field("volume_ratio").astype(float)
    stages = run.timings.stages
    return {
        "surface": min(sum(spent for name, spent in stages.items() if name.startswith("surface_energy.")), wall),
        "value": float(np.mean(pressures)) if pressures else float("nan"), "wall": wall, "steps": run.steps,
        "stopped": stopped, "compile": first_call_seconds(run), "particles": run.count,
        "ratio": distribution(ratio - ratio.mean()), "launches": len(run.plan.launches()),
        "bytes": sum(run.plan.field_bytes().values()),
    }  # fmt: skip


def pressures(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn, each repeat with a lattice turned otherwise: |p/p_L - 1| and seconds of stepping.

    settings  key to {"words", "knobs" (with "dtype", "step", "backend"), "radius" [cells], "tension", "shown",
    "probes": whether it may end in a stop}
    """
    first = {key: held(context, setting, 0, until=0.02 * UNTIL) for key, setting in settings.items()}
    found = rounds(context, settings, lambda key, k: held(context, settings[key], k), itemgetter("wall"), repeats)
    readings = []
    for key, setting in settings.items():
        runs = [reading[0] for reading in found[key].runs]
        values = [run["value"] for run in runs]
        stopped = next((run["stopped"] for run in runs if run["stopped"]), "")
        value = float(np.median(values))
        walls, surfaces = (found[key].means(itemgetter(name)) for name in ("wall", "surface"))
        readings.append(
            Reading(
                key, setting["words"], setting["knobs"], error=abs(value - 1), value=value, seconds=walls,
                per_step=[wall / run["steps"] for wall, run in zip(walls, runs)],
                parts={"surface": surfaces, "transfers": [w - s for w, s in zip(walls, surfaces)]},
                compile=first[key]["compile"], stopped=stopped, particles=runs[0]["particles"],
                steps=runs[0]["steps"], launches=runs[0]["launches"], bytes=runs[0]["bytes"],
                distribution={"J against its mean": runs[0]["ratio"]},
                shown=setting["shown"], expected=setting["probes"], noise=found[key].noise,
            )
        )  # fmt: skip
    return measured(readings, threads, backend)
