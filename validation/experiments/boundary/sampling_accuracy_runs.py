"""What the panels of sampling and signed distance measure: quality against iterations, distance against spacing."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.backends.arrays import choose, set_threads
from refsim.boundary.sampling import sample
from refsim.boundary.signed_distance import signed_distance
from validation.experiments.boundary.sampling_runs import evenness, near_surface, radius_for
from validation.experiments.boundary.sampling_shapes import SHAPES, known_distance, mesh_of
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context

PLACES = 4000


def quality(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Coefficient of variation of the spacing on the organic shape, and seconds, for each number of iterations."""
    there = choose(backend)
    set_threads(there, threads)
    mesh = mesh_of(SHAPES["organic"](4), "organic")
    readings = []
    try:
        for k, (key, setting) in enumerate(settings.items()):
            radius = radius_for(mesh.area, setting["count"])
            dtype = setting["knobs"]["dtype"]
            began = time.perf_counter()
            given = {"most_iterations": setting["iterations"], "backend": there, "dtype": dtype}
            found = sample(mesh, radius, **given)
            first = time.perf_counter() - began
            spent = []
            for _ in range(repeats):
                began = time.perf_counter()
                found = sample(mesh, radius, **given)
                spent.append(time.perf_counter() - began)
            from scipy.spatial import cKDTree

            nearest = cKDTree(found.position).query(found.position, k=2)[0][:, 1]
            error = evenness(found.position)["variation"]
            readings.append(
                Reading(
                    key, setting["words"], {**setting["knobs"], "iterations": found.iterations}, error=error,
                    value=error, seconds=spent, per_step=[s / max(found.iterations, 1) for s in spent],
                    parts={"sampling": spent}, compile=first,
                    distribution={"distance to the nearest / mean - 1": distribution(nearest / nearest.mean() - 1)},
                    particles=len(found.position), steps=found.iterations,
                )
            )  # fmt: skip
            context.progress((k + 1) / len(settings))
    finally:
        set_threads(there, None)
    return measured(readings, threads, backend)


def distance(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Root mean square error of the trilinear distance from a ball near its surface, seconds and bytes."""
    there = choose(backend)
    set_threads(there, threads)
    made = SHAPES["sphere"](6)
    mesh = mesh_of(made, "sphere")
    place = near_surface(made, 0.04, PLACES, 0)
    known = known_distance("sphere", place)
    readings = []
    try:
        for k, (key, setting) in enumerate(settings.items()):
            dtype, spacing = setting["knobs"]["dtype"], setting["knobs"]["spacing"]
            points = there.asarray(place.astype(dtype))
            began = time.perf_counter()
            band = signed_distance(mesh, spacing, backend=there, dtype=dtype)
            band.at(points)
            first = time.perf_counter() - began
            spent = []
            for _ in range(repeats):
                began = time.perf_counter()
                band = signed_distance(mesh, spacing, backend=there, dtype=dtype)
                there.synchronize()
                spent.append(time.perf_counter() - began)
            error = there.host(band.at(points)[0]).astype(float) - known
            rms = float(np.sqrt((error**2).mean()))
            knobs = {**setting["knobs"], "bytes": band.nbytes}
            readings.append(
                Reading(
                    key, f"{setting['words']}, {band.nbytes / 2**20:.2f} MiB", knobs, error=rms, value=rms,
                    seconds=spent, per_step=spent, parts={"field": spent}, compile=first,
                    distribution={"error [m]": distribution(error)}, particles=PLACES, bytes=band.nbytes // PLACES,
                )
            )  # fmt: skip
            context.progress((k + 1) / len(settings))
    finally:
        set_threads(there, None)
    return measured(readings, threads, backend)
