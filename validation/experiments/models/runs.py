"""Runs of the models: the droplet's cube to a ball."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from validation.experiments.droplet.runs import CALM, relaxed
from validation.experiments.models.scene import MODELS, PRINTED
from validation.metrics.droplet import sphericity, surface_mesh
from validation.results import Result, floats
from validation.running import Context

NEAR = 1.6  # radii about the middle: particles beyond are not of the drop
MOMENTS = {"third": 1 / 3, "late": 2 / 3, "end": 1.0}  # of the run, where its surface is measured


def relax(context: Context, model: str, shape: str, count: int, backend: str, seed: int = 1) -> Result:
    """From a cube to rest under one model; also when it came to rest, round or not, and what its surface is like.

    At rest from: the first sample from which on the kinetic energy stays below 1e-3 of its peak.
    """
    chosen = (MODELS | PRINTED)[model]
    result = relaxed(context, chosen.words, chosen.changes, shape, count, backend, seed=seed)
    values = dict(result.values)
    energy = floats(values["series"]["kinetic_energy"])
    busy = np.flatnonzero(~(energy <= CALM * energy.max()))
    first = int(busy.max(initial=-1)) + 1
    still = not values["stopped"] and first < len(energy)
    values["rest"] = {k: values["series"][k][first] for k in ("time", "wall", "steps")} if still else None
    frames = result.arrays["position"]
    last = len(frames) - 1
    values["surface"] = {
        name: surface(frames[round(share * last)], values["spacing"], values["radius"])
        for name, share in MOMENTS.items()
    }
    return Result(values, result.arrays)


def surface(position: NDArray, spacing: float, radius: float) -> dict[str, Any]:
    """What the surface of a drop is like.

    area      over that of a ball of the same volume (NaN where there is no one closed surface)
    gap       distance from a place on the surface to the nearest particle, 99th percentile, in spacings
    gyration  rms distance of the particles from their middle, in radii of the ball that they would fill
    thrown    particles that have left the drop
    """
    x = position.astype(float)
    x = x - np.median(x, axis=0)
    own = np.linalg.norm(x, axis=1) <= NEAR * radius
    drop = x[own]
    found = {"area": float("nan"), "gap": float("nan"), "thrown": int((~own).sum())}
    found["gyration"] = float(np.sqrt((drop**2).sum(1).mean()) / radius) if len(drop) else float("nan")
    try:
        vertices, faces = surface_mesh(drop, spacing)
        found["area"] = 1 / sphericity(vertices, faces)
        found["gap"] = float(np.quantile(cKDTree(drop).query(vertices)[0], 0.99) / spacing)
    except ValueError:  # torn apart
        pass
    return found
