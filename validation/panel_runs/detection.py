"""What the panels of surface detection measure: detectors on a stored cloud of the dam break."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from refsim import Scene, Simulation, SurfaceDetection
from validation.experiments.dam_break.runs import TRUTH_RADIUS, column_scene
from validation.experiments.dam_break.scene import TANK, load_state
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface, detection_score
from validation.results import Result
from validation.running import Context, stage_seconds
from validation.turns import Outcome, Readings, Settings, mean, measured, rounds

DENSITY = "density and number density"
PARTS = {  # of a detection, and how the names of their stages begin
    "threshold": ("surface_detection.near_surface", "surface_detection.candidates"),
    "normals": ("surface_normal.",),
    "scan": ("surface_detection.fan_scan",),
}


def detectors(
    state: str, context: Context, settings: Settings, backend: str, threads: int | None, repeats: int
) -> Result:
    """Detectors on a stored cloud, in turn: 1 - F1 against the exact surface, and seconds of the detection itself.

    settings  key to {"knobs", "effect" (fields of SurfaceDetection), "like" (key whose density pass does the same but
              for the asymmetry, or "")}

    What is counted: threshold, normals, scan, and what the asymmetry adds to the density pass. The density pass with
    the number density, which a liquid has anyway, and the list stand beside.
    """
    cloud = load_state(state)
    made: dict[str, Simulation] = {}
    for key, setting in settings.items():
        scene = detection_scene(state, setting["effect"], setting["knobs"]["dtype"])
        made[key] = context.simulation(scene, backend, threads)
        for _ in range(2):  # so that no first call is left in the times
            made[key].evaluate()
    first = next(iter(made.values()))
    spacing, walls = first.plan.grid.spacing, first.plan.walls.position
    cover = arc_cover_surface if cloud.depth == 1 else cap_cover_surface
    truth = cover(cloud.position, TRUTH_RADIUS * spacing, walls)

    def evaluated(key: str, k: int) -> Outcome:
        before = stage_seconds(made[key])
        made[key].evaluate()
        made[key].backend.synchronize()
        spent = {n: s - before.get(n, 0.0) for n, s in stage_seconds(made[key]).items()}
        return Spent(sum(s for n, s in spent.items() if n.startswith(PARTS)), spent["sph.density"])

    found = rounds(context, made, evaluated, lambda run: run.seconds, repeats)
    plain = {key: float(np.median(read.means(lambda run: run.beside[DENSITY]))) for key, read in found.items()}

    def judged(key: str, runs: list[Outcome], flags: NDArray, told: Mapping[str, Any]) -> list[Outcome]:
        parts = {name: mean(run.parts[name] for run in runs) for name in PARTS}
        beside = mean(run.beside[DENSITY] for run in runs)
        if like := settings[key]["like"]:
            parts["asymmetry"] = max(beside - plain[like], 0.0)
        parts = {name: seconds for name, seconds in parts.items() if seconds}
        value = 1.0 - detection_score(flags, truth).f1
        return [Outcome(value, sum(parts.values()), parts=parts, beside={DENSITY: beside}, **told)]

    readings = {}
    for key, read in found.items():
        flags, plan = made[key].field("surface").astype(bool), made[key].plan
        off = distribution(misplaced(cloud.position, flags, truth) / spacing)
        told = {
            "particles": made[key].count, "launches": len(plan.launches(on_demand=True)),
            "bytes": sum(plan.field_bytes().values()), "distribution": {"misplaced surface [spacings]": off},
        }  # fmt: skip
        readings[key] = Readings([judged(key, runs, flags, told) for runs in read.runs], read.noise)
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


def misplaced(position: np.ndarray, flags: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """How far each particle of the true or the detected surface lies from the other one [m]: 0 where both agree."""
    x = np.asarray(position, dtype=float)
    if not flags.any() or not truth.any():
        return np.full(int((flags | truth).sum()), np.nan if (flags | truth).any() else 0.0)
    missed = cKDTree(x[flags]).query(x[truth & ~flags])[0]
    extra = cKDTree(x[truth]).query(x[flags & ~truth])[0]
    return np.concatenate([np.zeros(int((flags & truth).sum())), missed, extra])
