"""What an accuracy panel of normals measures: error of the angle against the time that the normals take."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.backends.arrays import choose, set_threads
from refsim.surface_energy import Tension
from refsim.surface_energy.reconstruction import Reconstruction
from validation.experiments.surface_reconstruction import shapes
from validation.experiments.surface_reconstruction.runs import CELL, RADIUS
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context


def normals(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every way to normals, in turn, on one sphere of particles: mean angle to the true normal, and seconds.

    settings  key to {"words", "knobs" (with "dtype"), "tension" (parameters of the reconstruction), "radius"}

    Counted are offsets, fit and normals, for facets nothing but the facets; the level set and the mesh stand beside.
    """
    there = choose(backend)
    set_threads(there, threads)
    made, positions, compiling = {}, {}, {}
    try:
        for key, setting in settings.items():
            dtype = setting["knobs"]["dtype"]
            began = time.perf_counter()
            tension = Tension(surface_tension=1.0, inset=-1.0, **setting["tension"])
            made[key] = Reconstruction(there, 3, dtype, CELL, tension, timed=True)
            place = CELL * shapes.cloud("sphere", setting.get("radius", RADIUS))
            positions[key] = there.asarray(place.astype(dtype))
            made[key].surface(positions[key])
            compiling[key] = time.perf_counter() - began
        spent: dict[str, list[dict[str, float]]] = {key: [] for key in made}
        order = np.random.default_rng(0)
        for k in range(repeats):
            for key in order.permutation(list(made)).tolist():
                spent[key].append(dict(made[key].surface(positions[key]).seconds))
            context.progress((k + 1) / repeats)
        readings = []
        for key, setting in settings.items():
            surface = made[key].surface(positions[key])
            sample = there.host(surface.samples.position).astype(float) / CELL
            normal = there.host(surface.samples.normal).astype(float)
            radius = setting.get("radius", RADIUS)
            angle = shapes.angles(normal, shapes.true_normals(sample, "sphere", radius))
            own = ("samples",) if setting["tension"]["normals"] == "facets" else ("offsets", "fit", "normals")
            parts = {name: [row[name] for row in spent[key]] for name in own}
            beside = {"mesh": [row["cells"] + row["level set and facets"] for row in spent[key]]}
            seconds = np.sum(list(parts.values()), axis=0).tolist()
            readings.append(
                Reading(
                    key,
                    setting["words"],
                    setting["knobs"],
                    error=float(angle.mean()),
                    value=float(angle.mean()),
                    seconds=seconds,
                    per_step=seconds,
                    parts=parts,
                    beside=beside,
                    compile=compiling[key],
                    distribution={"angle [degrees]": distribution(angle)},
                    particles=int(positions[key].shape[0]),
                    shown="radius" not in setting,
                )
            )
    finally:
        set_threads(there, None)
    return measured(readings, threads, backend)
