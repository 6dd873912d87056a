"""How far a liquid is from a Taylor-Green vortex and from the flow of a cavity.

Positions and velocities are (n, dim) arrays of any program.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


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
    fit = np.empty(len(place))
    for k, x in enumerate(place):
        away = position - x
        weight = np.clip(1 - np.hypot(*away.T) / reach, 0, None)
        rows = np.column_stack([np.ones(len(away)), away]) * weight[:, None]
        fit[k] = np.linalg.lstsq(rows, values * weight, rcond=None)[0][0]
    return fit


# Ghia, Ghia & Shin, J. Comput. Phys. 48 (1982) 387, tables I and II, Re = 100: u/U over y at x = 1/2, v/U over x
GHIA_U = (
    (0.0547, -0.03717), (0.0625, -0.04192), (0.0703, -0.04775), (0.1016, -0.06434), (0.1719, -0.10150),
    (0.2813, -0.15662), (0.4531, -0.21090), (0.5, -0.20581), (0.6172, -0.13641), (0.7344, 0.00332), (0.8516, 0.23151),
    (0.9531, 0.68717), (0.9609, 0.73722), (0.9688, 0.78871), (0.9766, 0.84123),
)  # fmt: skip
GHIA_V = (
    (0.0625, 0.09233), (0.0703, 0.10091), (0.0781, 0.10890), (0.0938, 0.12317), (0.1563, 0.16077), (0.2266, 0.17507),
    (0.2344, 0.17527), (0.5, 0.05454), (0.8047, -0.24533), (0.8594, -0.22445), (0.9063, -0.16914), (0.9453, -0.10313),
    (0.9531, -0.08864), (0.9609, -0.07391), (0.9688, -0.05906),
)  # fmt: skip


def centre_lines(samples: Sequence[tuple[Any, Any]], reach: float) -> tuple[tuple[NDArray, NDArray], list[NDArray]]:
    """(mean velocities u along x = 1/2 and v along y = 1/2 of a cavity at Ghia's places, their differences from his).

    samples  positions and velocities (n, 2) at some moments; the lid moves with 1 m/s
    """
    up, across = np.array([(0.5, y) for y, _ in GHIA_U]), np.array([(x, 0.5) for x, _ in GHIA_V])
    u = np.mean([fitted(up, x, v[:, 0], reach) for x, v in samples], axis=0)
    v = np.mean([fitted(across, x, v[:, 1], reach) for x, v in samples], axis=0)
    return (u, v), [u - np.array(GHIA_U)[:, 1], v - np.array(GHIA_V)[:, 1]]
