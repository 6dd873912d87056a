"""How even particles on a surface are, and how even the wall's force is that they make."""

import math
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from refsim.boundary.sampling import HEXAGONAL

DARTS = 30  # places for each particle at which holes are sought
EXACT_QUERIES = 1000
FORCES = 2000  # places at which the wall's force is evaluated
SMOOTH_PART = 0.75  # cosine of the angle between normals near each other beyond which a place counts as at an edge
HOLE = 1.0  # distance from every particle, in mean spacings, at which another one would fit


def evenness(position: np.ndarray) -> dict[str, float]:
    """Distances to the nearest other particle: mean [m], least over mean, coefficient of variation."""
    nearest = cKDTree(position).query(position, k=2)[0][:, 1]
    mean = float(nearest.mean())
    return {"mean": mean, "least": float(nearest.min()) / mean, "variation": float(nearest.std()) / mean}


def holes(position: np.ndarray, darts: np.ndarray, size: float) -> int:
    """Places of `darts` (m, 3) further than `size` [m] from every particle, of two nearer than that one only."""
    distance = cKDTree(position).query(darts)[0]
    left = darts[distance > size][np.argsort(-distance[distance > size])]
    count = 0
    while len(left):
        count += 1
        left = left[np.linalg.norm(left - left[0], axis=1) > size]
    return count


def wall_force_noise(
    position: np.ndarray, normal: np.ndarray, place: np.ndarray, out: np.ndarray, apart: float
) -> float:
    """Unevenness of the wall's force on a resting layer of liquid: rms of what varies and of what is tangential, over
    its mean.

    place, out  (m, 3) places [m] on the surface, and the normals there
    apart       2 r [m], of the particles and of the layer from the wall

    The force for one pressure is -sum_b V_b grad W, V_b = 1/sum_k W_bk (patent P5, P6), by Wendland's kernel of support
    2.7 spacings; it varies from its mean within 3 spacings. Places at edges do not count: the force is no normal one
    there. nan where there are no others.
    """
    h = 2.7 * apart
    tree = cKDTree(position)

    def value(r: np.ndarray) -> np.ndarray:
        q = r / h
        return (1 - q) ** 4 * (4 * q + 1)

    def slope(r: np.ndarray) -> np.ndarray:
        q = r / h
        return -20 * q * (1 - q) ** 3 / h

    near = tree.query_ball_point(position, h)
    volume = np.array([1 / value(np.linalg.norm(position[k] - x, axis=1)).sum() for x, k in zip(position, near)])
    forces, there = [], []
    for x, n in zip(place + apart * out, out):
        k = tree.query_ball_point(x, h)
        if len(k) and (normal[k] @ n).min() > SMOOTH_PART:
            away = x - position[k]
            r = np.linalg.norm(away, axis=1)
            force = -(volume[k] * slope(r) / r) @ away
            forces.append((force @ n, np.linalg.norm(force - (force @ n) * n)))
            there.append(x)
    if not forces:
        return math.nan
    along, across = np.array(forces).T
    around = cKDTree(there).query_ball_point(there, 3 * apart)
    varies = along - np.array([along[k].mean() for k in around])  # the solid's curvature changes it more slowly
    return float(np.sqrt((varies**2 + across**2).mean()) / along.mean())


def score(position: np.ndarray, normal: np.ndarray, made: Any, radius: float, seed: int = 0) -> dict[str, float]:
    """How good a sampling of the trimesh mesh `made` is."""
    import trimesh

    spread = blueness(position, made.area)
    darts, face = trimesh.sample.sample_surface(made, DARTS * len(position), seed=seed)
    rows = np.random.default_rng(seed).choice(len(position), min(EXACT_QUERIES, len(position)), replace=False)
    off = trimesh.proximity.closest_point(made, position[rows])[1]
    expected = HEXAGONAL * made.area / (math.pi * radius**2)
    return {
        "particles": len(position), "expected": expected, "count_error": abs(len(position) - expected) / expected,
        **spread, "mean_over_2r": spread["mean"] / (2 * radius), "off": float(off.max()) / radius,
        "holes": holes(position, darts, HOLE * spread["mean"]),
        "force_noise": wall_force_noise(
            position, normal, darts[:FORCES], np.asarray(made.face_normals)[face[:FORCES]], 2 * radius
        ),
    }  # fmt: skip


def blueness(position: np.ndarray, area: float) -> dict[str, float]:
    """`evenness`, and the least distance over that of the densest packing of as many particles (blue-noise ratio)."""
    spread = evenness(position)
    hexagonal = math.sqrt(2 * area / (math.sqrt(3) * len(position)))
    return {**spread, "blue": spread["least"] * spread["mean"] / hexagonal}


def radius_for(area: float, count: int) -> float:
    """r [m] for which g A/(pi r^2) is `count`."""
    return math.sqrt(HEXAGONAL * area / (math.pi * count))
