"""Runs: detectors on clouds of every family, and in a splash, against the exact cover."""

from __future__ import annotations

from typing import Any

import numpy as np

from refsim import BoxWalls, Cloud, Scene, SurfaceDetection, WeaklyCompressible
from validation.experiments.dam_break.runs import SUPPORT, TRUTH_RADIUS, column_scene, jittered
from validation.experiments.thin_features.shapes import FAMILIES, SIDE
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface
from validation.results import Result
from validation.running import Context, advance

DETECTORS: dict[str, dict[str, Any]] = {  # settings of the effect
    "number_density": {"method": "number_density"},
    "color": {},
    "color_thin": {"thin_features": "second_moment"},
    "corrected": {"scan_normal": "corrected"},
    "corrected_thin": {"scan_normal": "corrected", "thin_features": "second_moment"},
}
WORDS = {
    "number_density": "number density",
    "color": "J(19)",
    "color_thin": "J(19), second moment",
    "corrected": "J(20)",
    "corrected_thin": "J(20), second moment",
}
MOMENTS = (0.3, 0.6, 0.8, 1.0)  # s of the splash


def clouds(context: Context, family: str, dim: int, seeds: list[int], backend: str) -> Result:
    """Hits, false surface and missed surface of every detector, pooled over the clouds of one family."""
    counts = {name: np.zeros(3, int) for name in DETECTORS}
    particles = 0
    made = [cloud for seed in seeds for cloud in FAMILIES[family][1](dim, np.random.default_rng(seed))]
    for k, (position, tank) in enumerate(made):
        size = float(SIDE[dim])
        walls = (BoxWalls(lower=(0.0, 0.0, 0.0), upper=(size,) * 3, open_faces=("+y",)),) if tank else ()
        particles += len(position)
        for name, settings in DETECTORS.items():
            scene = Scene(
                spacing=1.0,
                support_radius=SUPPORT,
                dim=dim,
                fluid=(Cloud(position=position),),
                effects=(WeaklyCompressible(sound_speed=10.0), *walls, SurfaceDetection(**settings)),
            )
            _count(context, scene, backend, counts[name])
        context.progress((k + 1) / len(made))
    return Result({"family": family, "dim": dim, "particles": particles, "score": _scores(counts)})


def splash(context: Context, columns: int, depth: int, seeds: list[int], backend: str) -> Result:
    """The same in a collapsing column, pooled over MOMENTS; the starts are jittered."""
    counts = {name: np.zeros(3, int) for name in DETECTORS}
    for seed in seeds:
        position, mass = jittered(columns, depth, seed)
        simulation = context.simulation(column_scene(columns, depth, cloud=(position, mass)), backend)
        for moment in MOMENTS:
            advance(simulation, [moment], lambda simulation, wall: None, context)
            cloud = (simulation.field("position"), simulation.field("mass"))
            for name, settings in DETECTORS.items():
                scene = column_scene(columns, depth, effects=(SurfaceDetection(**settings),), cloud=cloud)
                _count(context, scene, backend, counts[name])
    dim = 2 if depth == 1 else 3
    values = {"family": "splash", "dim": dim, "particles": len(mass) * len(MOMENTS) * len(seeds)}
    return Result(values | {"score": _scores(counts)})


def _count(context: Context, scene: Scene, backend: str, counts: np.ndarray) -> None:
    """Add (hits, false surface, missed surface) of the scene's particles."""
    simulation = context.simulation(scene, backend)
    simulation.evaluate()
    position, walls = simulation.field("position"), simulation.plan.walls
    cover = arc_cover_surface if scene.dim == 2 else cap_cover_surface
    truth = cover(position, TRUTH_RADIUS * scene.spacing, None if walls is None else walls.position)
    flags = simulation.field("surface").astype(bool)
    counts += ((flags & truth).sum(), (flags & ~truth).sum(), (~flags & truth).sum())


def _scores(counts: dict[str, np.ndarray]) -> dict[str, dict[str, float]]:
    return {
        name: {"precision": float(hit / max(hit + wrong, 1)), "recall": float(hit / max(hit + missed, 1))}
        for name, (hit, wrong, missed) in counts.items()
    }
