"""What the panels of surface detection measure: detectors on a stored cloud of the dam break."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from refsim import Scene, Simulation, SurfaceDetection
from validation.experiments.dam_break.runs import TRUTH_RADIUS, column_scene
from validation.experiments.dam_break.scene import TANK, load_state
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface, detection_score
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context, stage_seconds
from validation.turns import mean_parts, rounds


def detectors(
    state: str,
    context: Context,
    settings: Mapping[str, Mapping[str, Any]],
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
        scene = detection_scene(state, setting["effect"], setting["knobs"]["dtype"])
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


detectors_2d = partial(detectors, "dam_break_2d")
detectors_3d = partial(detectors, "dam_break_3d")


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
    )


def misplaced(position: np.ndarray, flags: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """How far each particle of the true or the detected surface lies from the other one [m]: 0 where both agree."""
    x = np.asarray(position, dtype=float)
    if not flags.any() or not truth.any():
        return np.full(int((flags | truth).sum()), np.nan if (flags | truth).any() else 0.0)
    missed = cKDTree(x[flags]).query(x[truth & ~flags])[0]
    extra = cKDTree(x[truth]).query(x[flags & ~truth])[0]
    return np.concatenate([np.zeros(int((flags & truth).sum())), missed, extra])
