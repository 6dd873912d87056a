"""Particle clouds cut by a sphere or an ellipsoid, and the true normals around them; lengths in cells."""

import numpy as np
from numpy.typing import NDArray

RADII = {"sphere": (1.0, 1.0, 1.0), "ellipsoid": (1.4, 1.0, 0.75)}
JITTER = 0.25  # largest displacement along each axis, in cells: half a particle spacing
Array = NDArray[np.float64]


def cloud(shape: str, radius: float, seed: int = 0, dim: int = 3) -> Array:
    """A jittered lattice of 2^dim particles to a cell, cut by the shape: (n, 3), z = 0 in the plane."""
    semi = radius * np.array(RADII[shape][:dim])
    half = int(2 * semi.max()) + 2
    axis = 0.5 * np.arange(-half, half) + 0.25
    place = np.stack(np.meshgrid(*[axis] * dim, indexing="ij"), axis=-1).reshape(-1, dim)
    place = place + np.random.default_rng(seed).uniform(-JITTER, JITTER, place.shape)
    return np.pad(place[((place / semi) ** 2).sum(1) < 1], ((0, 0), (0, 3 - dim)))


def lattice_block(count: int, seed: int = 0) -> Array:
    """About `count` particles: a cube of jittered lattice."""
    side = round(count ** (1 / 3))
    axis = 0.5 * (np.arange(side) + 0.5)
    place = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    return place + np.random.default_rng(seed).uniform(-0.1, 0.1, place.shape)


def true_normals(place: Array, shape: str, radius: float) -> Array:
    """Normals of the shape at its points nearest to places outside of it (n, 3)."""
    squares = (radius * np.array(RADII[shape])) ** 2
    low, high = np.full((len(place), 1), -0.9 * squares.min()), np.full((len(place), 1), 100.0 * squares.max())
    for _ in range(100):  # x = a^2 y/(a^2 + t) stands on the surface
        t = 0.5 * (low + high)
        beyond = ((place / (squares + t)) ** 2 * squares).sum(1, keepdims=True) > 1
        low, high = np.where(beyond, t, low), np.where(beyond, high, t)
    normal = place / (squares + low)
    return normal / np.linalg.norm(normal, axis=1, keepdims=True)


def angles(first: Array, second: Array) -> Array:
    """Angles [degrees] between unit vectors."""
    return np.degrees(np.arccos(np.clip((first * second).sum(1), -1.0, 1.0)))


def tilted(normal: Array, mean_angle: float, seed: int = 0) -> Array:
    """Unit vectors turned in random directions by angles whose mean is `mean_angle` [degrees]."""
    random = np.random.default_rng(seed)
    push = random.normal(size=normal.shape)
    push -= (push * normal).sum(1, keepdims=True) * normal
    best, low, high = normal, 0.0, 2.0
    for _ in range(60):
        size = 0.5 * (low + high)
        best = normal + size * push
        best = best / np.linalg.norm(best, axis=1, keepdims=True)
        low, high = (size, high) if angles(best, normal).mean() < mean_angle else (low, size)
    return best
