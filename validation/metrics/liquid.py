"""How far a liquid is from a tank at rest, from a Taylor-Green vortex and from the flow of a cavity.

Positions and velocities are (n, dim) arrays of any program.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray


def rest(position: NDArray, velocity: NDArray, depth: float, sound: float) -> dict[str, float]:
    """moving  root mean square speed over the sound speed; level_off  twice the mean height over the depth, off 1."""
    return {
        "moving": float(np.sqrt((velocity**2).sum(1).mean())) / sound,
        "level_off": abs(2 * float(position[:, -1].mean()) / depth - 1),
    }


def vortex(x: NDArray, time: float, reynolds: float) -> NDArray:
    """Velocity (n, 2) [m/s] of a Taylor-Green vortex in a periodic box of 1 m, of 1 m/s at the start."""
    k = 2 * math.pi
    u, v = -np.cos(k * x[:, 0]) * np.sin(k * x[:, 1]), np.sin(k * x[:, 0]) * np.cos(k * x[:, 1])
    return np.column_stack([u, v]) * math.exp(-2 * k**2 / reynolds * time)


def vortex_error(position: NDArray, velocity: NDArray, time: float, reynolds: float) -> float:
    """L2 norm of the difference to the exact velocities over theirs."""
    exact = vortex(position, time, reynolds)
    return float(np.linalg.norm(velocity[:, :2] - exact) / np.linalg.norm(exact))


def fitted(place: NDArray, position: NDArray, values: NDArray, reach: float) -> NDArray:
    """Linear fits at `place` (m, 2) [m] of values (n,) at `position` (n, 2) [m], weighted by (1 - r/reach)^2."""
    found = np.empty(len(place))
    for k, x in enumerate(place):
        away = position - x
        weight = np.clip(1 - np.hypot(*away.T) / reach, 0, None)
        rows = np.column_stack([np.ones(len(away)), away]) * weight[:, None]
        found[k] = np.linalg.lstsq(rows, values * weight, rcond=None)[0][0]
    return found


def cavity_error(samples: list[tuple[Any, Any]], ghia_u: Any, ghia_v: Any, reach: float) -> float:
    """Largest difference of the mean centre-line velocities from Ghia's, over the lid's speed of 1 m/s.

    samples  positions and velocities (n, 2) at some moments; ghia_u, ghia_v  (place, velocity) along x = 1/2, y = 1/2
    """
    up, across = np.array([(0.5, y) for y, _ in ghia_u]), np.array([(x, 0.5) for x, _ in ghia_v])
    u = np.mean([fitted(up, x, v[:, 0], reach) for x, v in samples], axis=0)
    v = np.mean([fitted(across, x, v[:, 1], reach) for x, v in samples], axis=0)
    return float(max(np.abs(u - np.array(ghia_u)[:, 1]).max(), np.abs(v - np.array(ghia_v)[:, 1]).max()))
