"""Runs of the droplet's accuracy panel: the roughness of a drop while it comes to rest, here and in another program."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim import Scene, Simulation
from refsim.core.errors import RunStopped
from validation.experiments.droplet.scene import VARIANTS, droplet_scene, particles
from validation.metrics.droplet import fibonacci_directions, radius_variation
from validation.metrics.shapes import shaken
from validation.peers import splishsplash
from validation.reading import Reading, distribution, first_kept, joules, kept_error, measured, scene_digest
from validation.results import Result
from validation.running import Context, first_call_seconds, refusal, stage_seconds, with_step
from validation.turns import repeated

UNTIL = 0.9  # s: 1.84 capillary times
SAMPLES = 45
BULK = 0.6  # of R: particles inside count as bulk
_warm: dict[str, float] = {}  # seconds of starting and first calls, by kind of scene, of this process


def drop_scene(
    side: int,
    dtype: str,
    variant: str = "default",
    changes: Mapping[str, Any] | None = None,
    shape: str = "cube",
    seed: int = 1,
    shake: int = 0,
) -> Scene:
    """The droplet of `scene.py` of about side^3 particles.

    changes  of `droplet_scene`; with "tension" those of the default model that differ
    seed     of the rotation of a start that is turned
    shake    seed of the particles' small displacements at the start
    """
    position, spacing, _ = particles(shape, side**3, seed)
    position = shaken(position, spacing, shake)
    merged = {**VARIANTS[variant].changes, **(changes or {})}
    return droplet_scene(position, spacing, **{"dtype": dtype, **merged})


def drops(
    context: Context, settings: Mapping[str, Mapping[str, Any]], peers: Mapping[str, Mapping[str, Any]], backend: str,
    threads: int | None, repeats: int,
) -> Result:  # fmt: skip
    """`roughness` of every setting, and `peer_roughness` of every peer, in turn."""
    return repeated(context, roughness, settings, peer_roughness, peers, backend, threads, repeats)


def roughness(
    context: Context,
    key: str,
    words: str,
    knobs: Mapping[str, Any],
    side: int,
    backend: str,
    threads: int | None,
    repeat: int,
    variant: str = "default",
    changes: Mapping[str, Any] | None = None,
    shape: str = "cube",
    seed: int = 1,
    expected: bool = False,
    shown: bool = True,
) -> Result:
    """A cube becomes a drop: radius variation against wall time; its point is the error that it keeps.

    knobs   "dtype" and "step" (share of the stable step, see `with_step`), and what else the setting differs in
    repeat  seed of the small displacements at the start, so that errors have a noise
    """
    scene = drop_scene(side, knobs["dtype"], variant, changes, shape, seed, repeat)
    scene = with_step(context, scene, float(knobs["step"]), backend, threads)
    if expected and (why := refusal(scene)):
        return measured([Reading(key, words, knobs, stopped=why, expected=True)], threads, backend)
    kind = json.dumps([knobs["dtype"], backend, variant, changes], sort_keys=True)
    compiling = None
    if kind not in _warm:
        began = time.perf_counter()
        first = context.simulation(scene, backend, threads)
        start = time.perf_counter() - began
        first.step()
        compiling = _warm[kind] = start + first_call_seconds(first)
    power = joules(backend)
    began = time.perf_counter()
    simulation = Simulation(scene, backend=backend, threads=threads or context.threads)
    start = time.perf_counter() - began
    walls, errors, lists = [], [], []
    wall, output, stopped = 0.0, 0.0, ""
    try:
        for at in np.linspace(0.0, UNTIL, SAMPLES + 1):
            began = time.perf_counter()
            while simulation.time < at:
                simulation.step()
            simulation.backend.synchronize()
            wall += time.perf_counter() - began
            began = time.perf_counter()
            position = simulation.field("position")
            output += time.perf_counter() - began
            walls.append(start + wall)
            errors.append(radius_variation(position) if np.isfinite(position).all() else float("nan"))
            lists.append(_list_seconds(simulation))
            context.progress(at / UNTIL)
    except RunStopped as error:
        stopped = f"{error.reason} at {simulation.time:.3f} s"
        wall += time.perf_counter() - began
    used = joules(backend)
    common = {
        "key": key, "words": words, "knobs": knobs, "compile": compiling, "particles": simulation.count,
        "steps": simulation.steps, "launches": len(simulation.plan.launches()), "expected": expected, "shown": shown,
        "bytes": sum(simulation.plan.field_bytes().values()), "scene": scene_digest(simulation.plan),
        "spent": start + wall,
    }  # fmt: skip
    kept = kept_error(errors)
    if not stopped and not math.isfinite(kept):
        stopped = "torn: no outer surface all around the drop's centre"
    elif not stopped and kept >= errors[0]:
        stopped = f"rougher than its start: keeps {kept:.2g}"
    if stopped:
        return measured([Reading(**common, stopped=stopped)], threads, backend)
    k = first_kept(errors, kept) or 0
    listed = lists[k]
    simulation.evaluate()
    reading = Reading(
        **common,
        error=kept,
        value=kept,
        seconds=[walls[k]],
        parts={"start": [start], "list": [listed], "step": [walls[k] - start - listed]},
        beside={"output": [output * (k + 1) / len(walls)]},
        per_step=[wall / simulation.steps],
        curve={"wall": walls, "error": errors},
        distribution={
            "outer radius against its mean": distribution(_radius_deviation(simulation.field("position"))),
            "density of the bulk against rest": distribution(_bulk_deviation(simulation)),
        },
        joules=[] if power is None or used is None else [used - power],
    )
    return measured([reading], threads, backend)


def _list_seconds(simulation: Simulation) -> float:
    """Wall seconds of building neighbour lists so far, the first one included."""
    first = simulation.timings.first_calls.get("neighbours", 0.0)
    return stage_seconds(simulation).get("neighbours", 0.0) + first


def _radius_deviation(position: np.ndarray) -> np.ndarray:
    """Outermost radius within 10 degrees of each of 200 directions, over its mean, less 1 (those of the roughness)."""
    offset = position.astype(float) - position.astype(float).mean(0)
    radius = np.linalg.norm(offset, axis=1)
    within = offset @ fibonacci_directions().T > math.cos(math.radians(10.0)) * radius[:, None]
    outermost = np.where(within, radius[:, None], 0.0).max(0)
    return outermost / outermost.mean() - 1.0


def _bulk_deviation(simulation: Simulation) -> np.ndarray:
    position, density = (simulation.field(name).astype(float) for name in ("position", "density"))
    away = np.linalg.norm(position - position.mean(0), axis=1)
    bulk = away < BULK * np.quantile(away, 0.99)
    return density[bulk] / simulation.plan.effects["weakly_compressible"].rest_density - 1.0


def reference_cost(
    context: Context, key: str, words: str, knobs: Mapping[str, Any], side: int, threads: int | None, repeats: int
) -> Result:
    """What the drop would cost on backend numpy, which compares all pairs: its own steps, timed one by one, times the
    number of steps that the run on the CPU takes to the error that it keeps. Both take the same steps up to rounding.
    """
    found = roughness(context, key, words, {**knobs, "backend": "cpu"}, side, "cpu", threads, 0)
    own = found.values["readings"][0]
    simulation = Simulation(drop_scene(side, knobs["dtype"]), backend="numpy")
    spent = []
    for _ in range(repeats):
        began = time.perf_counter()
        simulation.step()
        spent.append(time.perf_counter() - began)
    share = own["seconds"][0] / (own["per_step"][0] * own["steps"])
    steps = round(share * own["steps"])
    seconds = [s * steps for s in spent]
    reading = Reading(
        **{**own, "knobs": knobs, "seconds": seconds, "parts": {"step": seconds}, "beside": {}, "per_step": spent,
           "curve": {}, "compile": None},
    )  # fmt: skip
    return measured([reading], threads, "numpy")


def peer_roughness(
    context: Context,
    key: str,
    words: str,
    knobs: Mapping[str, Any],
    settings: Mapping[str, Any],
    threads: int,
    repeat: int,
) -> Result:
    """The same cube in SPlisHSPlasH (DFSPH, surface tension of Akinci et al. 2013), as a reading like the others."""
    found = splishsplash.run_drop({**settings, "shake": repeat}, threads)
    common = {"key": key, "words": words, "knobs": knobs, "expected": True, "particles": settings["side"] ** 3}
    if "missing" in found:
        return measured([Reading(**common, stopped=f"missing: {found['missing']}")], threads, "peer")
    error = [float(e) for e in found["error"]]
    kept = kept_error(error)
    if not math.isfinite(kept):
        return measured([Reading(**common, stopped="torn: no outer surface all around")], threads, "peer")
    k = first_kept(error, kept) or 0
    reading = Reading(
        **{**common, "particles": found["particles"]},
        error=kept,
        value=kept,
        steps=found["steps"],
        seconds=[found["wall"][k]],
        parts={"step": [found["wall"][k]]},
        per_step=[found["wall"][-1] / found["steps"]],
        curve={"wall": found["wall"], "error": error},
    )
    return measured([reading], threads, "peer", version=found["version"])


def force_rounding(
    context: Context, key: str, words: str, knobs: Mapping[str, Any], side: int, backend: str, threads: int | None
) -> Result:
    """Accelerations in float32 against float64 on one settled drop, particle by particle, over their rms."""
    simulation = context.simulation(drop_scene(side, "float32"), backend, threads)
    while simulation.time < 0.2:
        simulation.step()
    position = simulation.field("position").astype(float)
    both = []
    for dtype in ("float32", "float64"):
        spacing = simulation.plan.grid.spacing
        again = context.simulation(droplet_scene(position, spacing, dtype=dtype), backend, threads)
        again.evaluate()
        both.append(again.field("acceleration").astype(float))
        context.progress(0.5 * len(both))
    scale = math.sqrt(float((both[1] ** 2).sum(1).mean()))
    off = np.linalg.norm(both[0] - both[1], axis=1) / scale
    spread = {"acceleration, float32 against float64": distribution(off)}
    reading = Reading(key, words, knobs, error=float(np.median(off)), value=float(np.median(off)), shown=False,
                      distribution=spread, particles=simulation.count)  # fmt: skip
    return measured([reading], threads, backend)


# What an effect costs: scenes that differ in one


def effect_changes(name: str) -> dict[str, Any]:
    """Changes of `droplet_scene` with which the named part is off (or, for detection, on)."""
    return {
        "area": {"tension": {"area_term": "none"}},
        "correction": {"tension": {"density_correction": False}},
        "balance": {"tension": {"balance_pressure": False}, "sound_speed": 60.0},
        "detection": {"detection": True},
    }[name]
