"""Runs of the dam break's accuracy panels: detection on a stored cloud, and the surge front."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from refsim import Scene, Simulation, SurfaceDetection
from refsim.core.errors import RunStopped
from validation.experiments.dam_break.runs import DENSITY, GRAVITY, HEIGHT, LID, TRUTH_RADIUS, column_scene, viscosity
from validation.experiments.dam_break.state import TANK, load_state
from validation.metrics.dam_break import (
    FRONT_DATA,
    dimensionless_time,
    fit_time_offset,
    front_error,
    front_position,
    load_front_data,
)
from validation.metrics.shapes import shaken
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface, detection_score
from validation.peers import splishsplash
from validation.reading import Reading, distribution, joules, measured, scene_digest
from validation.results import Result
from validation.running import Context, first_call_seconds, refusal, stage_seconds, with_step
from validation.turns import mean_parts, repeated, rounds

WALLED = 15.0  # column widths: the tank of the front, as in `runs.surge`
PEER_STEP = 2e-3  # s, the longest of SPlisHSPlasH, which shortens it by the speed (CFL number 0.5)
MEAN = (1.0, 3.0)  # t sqrt(2 g/L) between which the mean front is the observable that settings are compared by
_warm: dict[str, float] = {}  # seconds of starting and first calls, by kind of scene, of this process


def detectors(
    context: Context,
    state: str,
    settings: Mapping[str, Mapping[str, Any]],
    dtype: str,
    backend: str,
    threads: int | None,
    repeats: int,
) -> Result:
    """Detectors on a stored cloud, in turn: 1 - F1 against the exact surface, and seconds of the detection itself.

    settings  key to {"words", "knobs", "effect" (fields of SurfaceDetection), "like" (key whose density pass does the
              same but for the asymmetry, or "")}

    What is counted: threshold, normals, scan, and what the asymmetry adds to the density pass. The density pass with
    the number density, which a liquid has anyway, and the list stand beside.
    """
    cloud = load_state(state)
    made: dict[str, Simulation] = {}
    compiling = {}
    for key, setting in settings.items():
        scene = detection_scene(state, setting["effect"], dtype)
        began = time.perf_counter()
        made[key] = context.simulation(scene, backend, threads)
        made[key].evaluate()
        compiling[key] = time.perf_counter() - began
        made[key].evaluate()  # so that no first call is left in the times
    first = next(iter(made.values()))
    spacing, walls = first.plan.grid.spacing, first.plan.walls.position
    cover = arc_cover_surface if cloud.depth == 1 else cap_cover_surface
    truth = cover(cloud.position, TRUTH_RADIUS * spacing, walls)

    def evaluated(key: str, k: int) -> dict[str, float]:
        before = stage_seconds(made[key])
        made[key].evaluate()
        made[key].backend.synchronize()
        return {n: s - before.get(n, 0.0) for n, s in stage_seconds(made[key]).items()}

    def counted(stages: Mapping[str, float]) -> float:
        return sum(s for name, s in stages.items() if name.startswith(("surface_detection.", "surface_normal.")))

    found = rounds(context, made, evaluated, counted, repeats)
    spent = {key: [mean_parts(runs) for runs in read.runs] for key, read in found.items()}
    readings = []
    for key, setting in settings.items():
        flags = made[key].field("surface").astype(bool)
        read = _detector_reading(key, setting, made[key], flags, truth, spent, compiling[key], cloud.position, spacing)
        readings.append(replace(read, noise=found[key].noise))
    return measured(readings, threads, backend)


def detection_scene(state: str, effect: Mapping[str, Any], dtype: str) -> Scene:
    """A stored cloud in its tank, with a detector."""
    import msgspec

    cloud = load_state(state)
    fields = {name: tuple(value) if isinstance(value, list) else value for name, value in effect.items()}
    scene = column_scene(cloud.columns, cloud.depth, TANK, (SurfaceDetection(**fields),), (cloud.position, cloud.mass))
    return msgspec.structs.replace(scene, dtype=dtype)


def _detector_reading(
    key: str,
    setting: Mapping[str, Any],
    simulation: Simulation,
    flags: np.ndarray,
    truth: np.ndarray,
    spent: Mapping[str, list[dict[str, float]]],
    compiling: float,
    position: np.ndarray,
    spacing: float,
) -> Reading:
    readings = spent[key]
    parts: dict[str, list[float]] = {
        "threshold": [
            sum(s for n, s in r.items() if n in ("surface_detection.near_surface", "surface_detection.candidates"))
            for r in readings
        ],
        "normals": [sum(s for n, s in r.items() if n.startswith("surface_normal.")) for r in readings],
        "scan": [r.get("surface_detection.fan_scan", 0.0) for r in readings],
    }
    like = setting["like"]
    if like:
        plain = float(np.median([r["sph.density"] for r in spent[like]]))
        parts["asymmetry"] = [max(r["sph.density"] - plain, 0.0) for r in readings]
    seconds = np.sum(list(parts.values()), axis=0)
    score = detection_score(flags, truth)
    return Reading(
        key=key,
        words=setting["words"],
        knobs=setting["knobs"],
        error=1.0 - score.f1,
        value=1.0 - score.f1,
        seconds=seconds.tolist(),
        parts={name: values for name, values in parts.items() if any(values)},
        beside={"density and number density": [r["sph.density"] for r in readings]},
        per_step=seconds.tolist(),
        compile=compiling,
        distribution={
            "misplaced surface [spacings]": distribution(misplaced(position, flags, truth) / spacing),
        },
        particles=simulation.count,
        launches=len(simulation.plan.launches(on_demand=True)),
        bytes=sum(simulation.plan.field_bytes().values()),
        scene=scene_digest(simulation.plan),
    )


def misplaced(position: np.ndarray, flags: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """How far each particle of the true or the detected surface lies from the other one [m]: 0 where both agree."""
    x = np.asarray(position, dtype=float)
    if not flags.any() or not truth.any():
        return np.full(int((flags | truth).sum()), np.nan if (flags | truth).any() else 0.0)
    missed = cKDTree(x[flags]).query(x[truth & ~flags])[0]
    extra = cKDTree(x[truth]).query(x[flags & ~truth])[0]
    return np.concatenate([np.zeros(int((flags & truth).sum())), missed, extra])


def fronts(
    context: Context, settings: Mapping[str, Mapping[str, Any]], peers: Mapping[str, Mapping[str, Any]], backend: str,
    threads: int | None, repeats: int,
) -> Result:  # fmt: skip
    """`front` of every setting, and `peer_front` of every peer, in turn."""
    return repeated(context, front, settings, peer_front, peers, backend, threads, repeats)


def front(
    context: Context,
    key: str,
    words: str,
    knobs: Mapping[str, Any],
    columns: int,
    effects: Mapping[str, Mapping[str, Any]],
    backend: str,
    threads: int | None,
    repeat: int,
    expected: bool = False,
    until: float = 4.6,
) -> Result:
    """The surge front up to t sqrt(2g/L) = `until`: its largest deviation from Martin & Moyce 1952 (2.25 in).

    One time offset is fitted, as the gate's moment is uncertain. The observable itself is the mean front over MEAN.
    knobs  "dtype" and "step" (share of the stable step, see `with_step`), and what else the setting differs in
    repeat  seed of the small displacements at the start, so that errors have a noise
    """
    scene = front_scene(columns, knobs["dtype"], effects, repeat)
    scene = with_step(context, scene, float(knobs["step"]), backend, threads)
    if expected and (why := refusal(scene)):
        return measured([Reading(key, words, knobs, stopped=why, expected=True)], threads, backend)
    kind = json.dumps([knobs["dtype"], backend, sorted(effects)])
    compiling = None
    if kind not in _warm:
        compiling = _warm[kind] = warm_up(context, scene, backend, threads)
    power = joules(backend)
    began = time.perf_counter()
    simulation = Simulation(scene, backend=backend, threads=threads or context.threads)
    start = time.perf_counter() - began
    width = 0.5 * HEIGHT
    scale = math.sqrt(width / (2.0 * GRAVITY))
    series = load_front_data("martin_moyce_2.25in")
    times, reach, wall, output, stopped = [], [], 0.0, 0.0, ""
    try:
        for at in np.arange(0.0, until + 0.025, 0.05) * scale:
            began = time.perf_counter()
            while simulation.time < at:
                simulation.step()
            simulation.backend.synchronize()
            wall += time.perf_counter() - began
            began = time.perf_counter()
            position = simulation.field("position")[:, :2]
            output += time.perf_counter() - began
            times.append(float(dimensionless_time(simulation.time, width, GRAVITY)))
            reach.append(front_position(position, scene.spacing).connected / width)
            context.progress(at / (until * scale))
    except RunStopped as error:
        stopped = f"{error.reason} at {simulation.time:.3f} s"
        wall += time.perf_counter() - began
    listed = list_seconds(simulation)
    common = {
        "key": key, "words": words, "knobs": knobs, "compile": compiling, "particles": simulation.count,
        "steps": simulation.steps, "launches": len(simulation.plan.launches()), "expected": expected,
        "bytes": sum(simulation.plan.field_bytes().values()), "scene": scene_digest(simulation.plan),
    }  # fmt: skip
    if stopped:
        return measured([Reading(**common, stopped=stopped, spent=start + wall)], threads, backend)
    offset = fit_time_offset(times, reach, series).offset
    error = front_error(times, reach, series, offset)
    at = series.time + offset
    inside = (at >= times[0]) & (at <= times[-1])
    deviation = np.interp(at[inside], times, reach) / series.front[inside] - 1.0
    used = joules(backend)
    reading = Reading(
        **common,
        error=abs(error.largest),
        value=float(np.interp(np.linspace(*MEAN, 41), times, reach).mean()),
        seconds=[start + wall],
        parts={"start": [start], "list": [listed], "step": [wall - listed]},
        beside={"output": [output]},
        per_step=[wall / simulation.steps],
        distribution={"deviation from a datum": distribution(deviation)},
        joules=[] if power is None or used is None else [used - power],
    )
    return measured([reading], threads, backend, offset=offset, at_data={
        name: abs(front_error(times, reach, load_front_data(name),
                              fit_time_offset(times, reach, load_front_data(name)).offset).largest)
        for name in FRONT_DATA
    })  # fmt: skip


def peer_front(
    context: Context, key: str, words: str, knobs: Mapping[str, Any], columns: int, threads: int, repeat: int,
    until: float = 4.6,
) -> Result:  # fmt: skip
    """The same column in SPlisHSPlasH (DFSPH), with refsim's kinematic viscosity, as a reading like the others."""
    width = 0.5 * HEIGHT
    scale = math.sqrt(width / (2.0 * GRAVITY))
    spacing = width / columns
    settings = {
        "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": PEER_STEP,
        "viscosity": viscosity(spacing) / DENSITY, "shake": repeat,
        "times": [float(at) for at in np.arange(0.0, until + 0.025, 0.05) * scale],
    }  # fmt: skip
    found = splishsplash.run_column(settings, threads)
    common = {"key": key, "words": words, "knobs": knobs, "expected": True}
    if "missing" in found:
        return measured([Reading(**common, stopped=f"missing: {found['missing']}")], threads, "peer")
    times = dimensionless_time(np.array(found["time"]), width, GRAVITY)
    reach = np.array(found["front"]) / width
    series = load_front_data("martin_moyce_2.25in")
    error = front_error(times, reach, series, fit_time_offset(times, reach, series).offset)
    seconds = found["wall"][-1]
    reading = Reading(
        **common,
        error=abs(error.largest),
        value=float(np.interp(np.linspace(*MEAN, 41), times, reach).mean()),
        seconds=[seconds],
        parts={"step": [seconds]},
        per_step=[seconds / found["steps"]],
        particles=found["particles"],
        steps=found["steps"],
    )
    return measured([reading], threads, "peer", version=found["version"])


def front_scene(columns: int, dtype: str, effects: Mapping[str, Mapping[str, Any]], shake: int = 0) -> Scene:
    """The column in the long tank, its particles displaced a little; effects by name, with their fields."""
    import msgspec

    from refsim.core.effect import EFFECTS

    more = tuple(EFFECTS[name](**fields) for name, fields in effects.items())
    spacing = 0.5 * HEIGHT / columns
    cells = np.stack(np.meshgrid(np.arange(columns), np.arange(2 * columns), [0.0], indexing="ij"), axis=-1)
    position = (cells.reshape(-1, 3) + (0.5, 0.5, 0.0)) * spacing
    scene = column_scene(columns, 1, WALLED, more, (shaken(position, spacing, shake), None))
    return msgspec.structs.replace(scene, dtype=dtype)


def warm_up(context: Context, scene: Scene, backend: str, threads: int | None) -> float:
    """Compile or load all that the scene needs, in a simulation of its own; the seconds of starting and first calls."""
    began = time.perf_counter()
    simulation = context.simulation(scene, backend, threads)
    start = time.perf_counter() - began
    simulation.step()
    simulation.evaluate()
    return start + first_call_seconds(simulation)


def list_seconds(simulation: Simulation) -> float:
    """Wall seconds of building neighbour lists, the first one included."""
    timings = simulation.timings
    return timings.stages.get("neighbours", 0.0) + timings.first_calls.get("neighbours", 0.0)
