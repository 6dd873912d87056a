"""Drops in space at twice the resolution of `drops`, for pictures: the smooth surface around their particles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from refsim import RunStopped
from refsim.render.surfaces import distances
from validation.experiments.mpm_droplet.scene import MODULUS, drop_scene, ellipsoid
from validation.results import Result
from validation.running import Context

CELL = 1 / 64  # h [m], half of that of `drops` in space
NODE = 0.75  # cells between the nodes at which the distance is kept
UNIT = 0.01  # cells, of the distances that are kept
RUNS: dict[str, dict[str, Any]] = {
    # at the default lambda and step the neck that closes is compressed too far
    "collision": {
        "body": "collision", "radius": 10.0, "shown": [0.0, 0.02, 0.05, 0.1, 0.15, 0.2], "modulus": 2000.0,
        "step": 5e-5,
    },
    "merging": {"body": "merging", "radius": 10.0, "shown": [0.0, 0.01, 0.03, 0.06, 0.1, 0.3], "viscosity": 0.05},
    **{
        f"floor_{angle}": {
            "body": "floor", "radius": 12.0, "shown": [0.0, 0.05, 0.1, 0.15, 0.2, 0.5], "viscosity": 0.05,
            "angle": angle,
        }
        for angle in (60, 90, 120)
    },
}  # fmt: skip


def kept_distance(position: NDArray) -> tuple[NDArray[np.int16], NDArray[np.int8]]:
    """The grid's first node (3,) and the distance at its nodes in UNIT cells, cut off at 127, of particles [cells]."""
    first, phi, _ = distances(position, 0.5, NODE)
    return first.astype(np.int16), np.clip(np.round(phi / UNIT), -127, 127).astype(np.int8)


def smooth(
    context: Context, backend: str, body: str, radius: float, shown: Sequence[float], viscosity: float = 0.0,
    angle: float | None = None, modulus: float = MODULUS, step: float = 0.0,
) -> Result:  # fmt: skip
    """Surfaces of a body at the times `shown` [s], and why the run stopped or "".

    body    "collision": balls of `radius` [cells] that meet off their axis, each at 1 m/s; "merging": two that touch,
            at rest; "floor": half a ball on a slipping floor whose contact angle is `angle` [degrees]
    """
    place = ellipsoid(radius, 3, seed=1 if body == "floor" else None)
    tension: dict[str, Any] = {}
    walls: Mapping[str, Any] | None = None
    speed = 0.0
    if body == "floor":
        far = float(math.ceil(4 * radius))
        place, tension = place[place[:, 1] > 0], {"contact_angle": angle}
        walls = {"lower": (-far, 0.0, -far), "upper": (far, far, far), "rule": "slip"}
    else:
        speed = 1.0 if body == "collision" else 0.0
        apart = np.array([radius + 2.0, 0.25 * radius, 0.0] if body == "collision" else [radius, 0.0, 0.0])
        place = np.vstack([place - apart, place + apart])
    velocity = np.zeros((len(place), 3))
    velocity[:, 0] = -speed * np.sign(place[:, 0])
    scene = drop_scene(place, 3, velocity=velocity, tension=tension, walls=walls, cell=CELL, step=step,
                       liquid={"dynamic_viscosity": viscosity, "bulk_modulus": modulus})  # fmt: skip
    run = context.simulation(scene, backend)
    kept, stopped, waiting = {}, "", sorted(shown)
    try:
        while waiting:
            if run.time >= waiting[0] - 1e-9:
                k = len(shown) - len(waiting)
                kept[f"first_{k}"], kept[f"distance_{k}"] = kept_distance(run.field("position").astype(float) / CELL)
                waiting.pop(0)
                continue
            run.step()
            context.progress(run.time / max(shown))
    except RunStopped as stop:
        stopped = f"{stop.reason} in step {run.steps}"
    return Result({"shown": list(shown), "stopped": stopped, "steps": run.steps, "particles": run.count}, kept)
