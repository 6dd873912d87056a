"""Runs of the droplet."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim import Simulation
from refsim.core.errors import RunStopped
from validation.experiments.droplet.scene import END_TIME, VARIANTS, droplet_scene, particles
from validation.metrics.droplet import (
    cubic_moment,
    inertia_anisotropy,
    nearest_neighbour_distance,
    radius_variation,
    radius_variation_scale,
    sphericity,
    surface_mesh,
)
from validation.results import Result
from validation.running import Context, advance, momenta, search_log, stage_seconds

SAMPLES = 72
BULK = 0.6  # of R: particles inside count as bulk
CALM = 1e-3  # of the peak: kinetic energy below which a drop is at rest
ROUND = 0.005  # radius variation of a settled drop


def relax(
    context: Context,
    shape: str,
    count: int,
    backend: str,
    variant: str = "default",
    until: float = END_TIME,
    samples: int = SAMPLES,
    detection: bool = False,
    seed: int = 1,
    tension: dict[str, Any] | None = None,
    dtype: str = "float32",
) -> Result:
    """From `shape` to rest under a variant of the model; a run that stops is a result, with its reason.

    tension  parameters of the tension in place of the variant's
    """
    changes: dict[str, Any] = {**VARIANTS[variant].changes, "detection": detection, "dtype": dtype}
    if tension is not None:
        changes["tension"] = {**changes.get("tension", {}), **tension}
    return relaxed(context, VARIANTS[variant].words, changes, shape, count, backend, until, samples, seed)


def relaxed(
    context: Context,
    words: str,
    changes: Mapping[str, Any],
    shape: str,
    count: int,
    backend: str,
    until: float = END_TIME,
    samples: int = SAMPLES,
    seed: int = 1,
) -> Result:
    """From `shape` to rest under `changes` to the droplet's scene; a run that stops is a result, with its reason.

    Steady from: the first sample from which on the kinetic energy stays below 1e-3 of its peak and the radius variation
    below 0.005. Momenta refer to the largest sum of moduli met.
    """
    position, spacing, axes = particles(shape, count, seed)
    simulation = context.simulation(droplet_scene(position, spacing, **changes), backend)
    radius = spacing * (3.0 * simulation.count / (4.0 * math.pi)) ** (1.0 / 3.0)
    series: dict[str, list[Any]] = {}
    frames, wall, stopped = [], 0.0, ""

    def sample(simulation: Simulation, wall: float) -> None:
        simulation.evaluate()
        x = simulation.field("position").astype(float)
        away = np.linalg.norm(x - x.mean(0), axis=1)
        bulk = simulation.field("density").astype(float)[away < BULK * radius]
        near = nearest_neighbour_distance(x) / spacing
        stages = stage_seconds(simulation)
        row = {
            "time": simulation.time,
            "wall": wall,
            "steps": simulation.steps,
            "radius_variation": radius_variation(x),
            "cubic_moment": cubic_moment(x, axes),
            "anisotropy": inertia_anisotropy(x),
            "extent": float(away.max()) / radius,
            "nn_min": float(near.min()),
            "nn_5": float(np.quantile(near, 0.05)),
            "nn_mean": float(near.mean()),
            "bulk_error": float(bulk.mean()) - 1.0 if len(bulk) else float("nan"),
            "bulk_spread": float(bulk.std()) if len(bulk) else float("nan"),
            "surface_share": float(simulation.field("surface").mean()) if "surface" in simulation.fields else None,
            "stages": stages,
            **momenta(simulation),
        }
        for name, value in row.items():
            series.setdefault(name, []).append(value)
        frames.append(x.astype(np.float32))

    times = np.linspace(0.0, until, samples + 1).tolist()
    try:
        wall = advance(simulation, times, sample, context)
    except RunStopped as error:
        stopped = f"{error.reason} at {simulation.time:.3f} s"
    final = frames[-1].astype(float)
    try:
        roundness = sphericity(*surface_mesh(final, spacing))
    except ValueError:  # torn apart: no one closed surface
        roundness = float("nan")
    energy, variation = np.array(series["kinetic_energy"]), np.array(series["radius_variation"])
    peak = float(energy.max())
    settled = (energy <= CALM * peak) & (variation <= ROUND)
    steady = None if stopped or not settled[-1] else int(np.flatnonzero(~settled).max(initial=-1)) + 1
    late = energy[-max(1, samples // 20) :]
    values = {
        "particles": simulation.count,
        "spacing": spacing,
        "radius": radius,
        "capillary_time": math.sqrt(radius**3),
        "words": words,
        "stopped": stopped,
        "series": series,
        "lattice": radius_variation_scale(simulation.count)._asdict(),
        "end": {
            "radius_variation": float(variation[-1]),
            "sphericity": roundness,
            "cubic_moment": series["cubic_moment"][-1],
            "anisotropy": series["anisotropy"][-1],
            "extent": series["extent"][-1],
            "nn_min": series["nn_min"][-1],
            "nn_5": series["nn_5"][-1],
            "nn_mean": series["nn_mean"][-1],
            "bulk_error": series["bulk_error"][-1],
            "bulk_spread": series["bulk_spread"][-1],
            "kinetic_share": float(late.mean()) / peak if peak > 0 else float("nan"),
            "momentum": _share(series["momentum"][-1], series["momentum_scale"]),
            "angular_momentum": _share(series["angular_momentum"][-1], series["angular_scale"]),
        },
        "steady": None if steady is None else {k: series[k][steady] for k in ("time", "wall", "steps", "stages")},
        "steps": simulation.steps,
        "seconds": wall,
        "search": search_log(simulation),
    }
    return Result(values, {"position": np.array(frames), "axes": axes})


def _share(vector: np.ndarray, scales: list[float]) -> float:
    largest = max(scales)
    return float(np.linalg.norm(vector)) / largest if largest > 0 else 0.0
