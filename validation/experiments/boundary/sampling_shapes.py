"""Meshes that particles are spread over, about 2 m across, and distances that are known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from refsim.boundary.mesh import SurfaceMesh, surface_mesh

TORUS = (1.0, 0.35)  # radii of the ring and of its tube [m]
CUBE = 1.0  # side [m]
PLATE = (1.6, 1.2, 0.1)  # [m]
NEEDLE = (0.12, 2.0)  # radius and length of a cone [m]
TILT = 0.5  # rad, so that no face lies along the grid


def sphere(level: int = 5) -> Any:
    """Ball of 1 m."""
    import trimesh

    return trimesh.creation.icosphere(level)


def torus(level: int = 5) -> Any:
    """Ring of 1 m with a tube of 0.35 m."""
    import trimesh

    return trimesh.creation.torus(*TORUS, major_sections=6 * 2**level // 2, minor_sections=3 * 2**level // 2)


def cube(level: int = 5) -> Any:
    """Cube of 1 m: 12 triangles."""
    return tilted(_boxed((CUBE,) * 3))


def plate(level: int = 5) -> Any:
    """Plate 0.1 m thick."""
    return tilted(_boxed(PLATE))


def needle(level: int = 5) -> Any:
    """Cone of 2 m with a tip of 7 degrees."""
    import trimesh

    return tilted(trimesh.creation.cone(*NEEDLE, sections=64))


def organic(level: int = 5) -> Any:
    """A ball with lobes and hollows: its radius follows a few waves."""
    made = sphere(level)
    x, y, z = np.array(made.vertices).T
    radius = 1 + 0.22 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.15 * np.sin(4 * z + 2 * y) + 0.08 * np.cos(7 * x * y)
    made.vertices = np.array(made.vertices) * radius[:, None]
    return made


def _boxed(size: tuple[float, ...]) -> Any:
    import trimesh

    return trimesh.creation.box(size)


def tilted(made: Any) -> Any:
    """Turned by TILT about a direction along no axis."""
    import trimesh

    made.apply_transform(trimesh.transformations.rotation_matrix(TILT, (1.0, 0.7, 0.2)))
    return made


SHAPES: dict[str, Callable[..., Any]] = {
    "sphere": sphere, "torus": torus, "cube": cube, "needle": needle, "plate": plate, "organic": organic,
}  # fmt: skip


def mesh_of(made: Any, name: str = "mesh") -> SurfaceMesh:
    """What trimesh holds, as refsim takes it."""
    return surface_mesh(made.vertices, made.faces, name)


def known_distance(shape: str, place: np.ndarray) -> np.ndarray:
    """Signed distance [m] (n,) of points (n, 3) [m] from the sphere, the torus or the cube."""
    if shape == "sphere":
        return np.linalg.norm(place, axis=1) - 1
    if shape == "torus":
        ring = np.linalg.norm(place[:, :2], axis=1) - TORUS[0]
        return np.hypot(ring, place[:, 2]) - TORUS[1]
    import trimesh

    turn = trimesh.transformations.rotation_matrix(TILT, (1.0, 0.7, 0.2))[:3, :3]
    over = np.abs(place @ turn) - 0.5 * CUBE
    return np.linalg.norm(np.maximum(over, 0), axis=1) + np.minimum(over.max(1), 0)
