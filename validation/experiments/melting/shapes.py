"""Rabbit and duck: closed meshes made of ellipsoids, generated here and free for any use."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from refsim.backends.arrays import Backend
from refsim.isosurface import extract

# Ellipsoids: center, half axes, turn about y [degrees]; x is forward, z is up, and pairs lie at both sides of y = 0.
RABBIT = (
    ((0.00, 0.00, 0.00), (0.62, 0.46, 0.52), -12),  # trunk
    ((-0.38, 0.00, -0.12), (0.42, 0.48, 0.46), 0),  # haunches
    ((0.52, 0.00, 0.46), (0.36, 0.31, 0.32), 0),  # head
    ((0.76, 0.00, 0.38), (0.17, 0.17, 0.15), 0),  # muzzle
    ((0.28, 0.15, 1.02), (0.14, 0.11, 0.50), 24),  # ears
    ((0.28, -0.15, 1.02), (0.14, 0.11, 0.50), 24),
    ((0.34, 0.27, -0.46), (0.34, 0.15, 0.15), 0),  # paws
    ((0.34, -0.27, -0.46), (0.34, 0.15, 0.15), 0),
    ((-0.26, 0.36, -0.48), (0.42, 0.17, 0.15), 0),
    ((-0.26, -0.36, -0.48), (0.42, 0.17, 0.15), 0),
    ((-0.84, 0.00, -0.06), (0.19, 0.18, 0.18), 0),  # tail
)
DUCK = (
    ((0.00, 0.00, 0.00), (0.80, 0.52, 0.44), 0),  # trunk
    ((0.30, 0.00, 0.10), (0.46, 0.44, 0.42), 0),  # breast
    ((0.48, 0.00, 0.46), (0.22, 0.22, 0.38), 10),  # neck
    ((0.54, 0.00, 0.82), (0.33, 0.30, 0.30), 0),  # head
    ((0.90, 0.00, 0.76), (0.24, 0.20, 0.09), 0),  # bill
    ((-0.74, 0.00, 0.26), (0.36, 0.26, 0.15), 38),  # tail
    ((-0.10, 0.46, 0.08), (0.46, 0.16, 0.26), 8),  # wings
    ((-0.10, -0.46, 0.08), (0.46, 0.16, 0.26), 8),
)
ANIMALS = {"rabbit": RABBIT, "duck": DUCK}


def field(parts: tuple, points: NDArray) -> NDArray[np.float64]:
    """Negative inside the union of ellipsoids, positive outside: smallest of (|u| - 1), u in half axes."""
    value = np.full(len(points), np.inf)
    for center, axes, turn in parts:
        c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
        away = points - np.array(center)
        x, z = c * away[:, 0] + s * away[:, 2], c * away[:, 2] - s * away[:, 0]
        u = np.stack([x, away[:, 1], z], axis=1) / np.array(axes)
        value = np.minimum(value, np.linalg.norm(u, axis=1) - 1)
    return value


def mesh(animal: str, cell: float = 0.05) -> tuple[NDArray, NDArray]:
    """(vertices, triangles) of an animal about 2 units long, by marching cubes."""
    count = int(np.ceil(1.7 / cell))
    axis = np.arange(-count, count + 1)
    coordinates = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    shift = cell * np.array([0.317, 0.211, 0.407])  # no node on the surface, where triangles would have no area
    found = extract(Backend("cpu"), coordinates, field(ANIMALS[animal], cell * coordinates + shift), cell, 3)
    return np.asarray(found.vertices), np.asarray(found.facets)


def write_mesh(animal: str, folder: str | Path) -> tuple[str, float]:
    """Write an animal as an STL file into a folder; its path, and its height over its longest edge."""
    import trimesh

    path = Path(folder) / f"{animal}.stl"
    vertices, facets = mesh(animal)
    trimesh.Trimesh(vertices, facets).export(path)
    edges = np.ptp(vertices, axis=0)
    return str(path), float(edges[2] / edges.max())
