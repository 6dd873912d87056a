"""Meshes that liquid falls on, lies in and runs through; lengths in metres, made anew for every run."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

SPACING = 0.01  # of the liquid [m]
SUPPORT = 2.7 * SPACING


def sphere() -> Any:
    """Ball of 5 spacings."""
    import trimesh

    return trimesh.creation.icosphere(subdivisions=3, radius=5 * SPACING)


def torus() -> Any:
    """Lying ring, 6 and 2.2 spacings."""
    import trimesh

    return trimesh.creation.torus(6 * SPACING, 2.2 * SPACING, major_sections=48, minor_sections=24)


def cube() -> Any:
    """Cube of 8 spacings, on an edge."""
    import trimesh

    made = trimesh.creation.box((8 * SPACING,) * 3)
    made.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, (1, 0, 0)))
    return made


def needle() -> Any:
    """Upright cone, 3 spacings wide and 16 high, with its point up."""
    import trimesh

    made = trimesh.creation.cone(1.5 * SPACING, 16 * SPACING, sections=16)
    made.apply_translation((0, 0, -8 * SPACING))
    return made


def plate() -> Any:
    """Lying plate, one spacing thick, 12 wide."""
    import trimesh

    return trimesh.creation.box((12 * SPACING, 12 * SPACING, SPACING))


def funnel() -> Any:
    """Cone from 10 spacings down to a spout of 2.6, its wall 1.5 thick."""
    import trimesh

    d = SPACING
    line = np.array([[2.6, -8], [4.1, -8], [4.1, -4.5], [11.5, 4], [10, 4], [2.6, -4]]) * d
    made = trimesh.creation.revolve(np.vstack([line, line[:1]]), sections=40)
    made.fix_normals()
    return made


def pebble() -> Any:
    """Ball with bumps, an organic shape of 6 spacings."""
    import trimesh

    made = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    x = np.asarray(made.vertices)
    bump = 1 + 0.16 * np.sin(3 * x[:, 0] + 1) * np.cos(4 * x[:, 1]) + 0.12 * np.sin(5 * x[:, 2] + 2 * x[:, 0])
    return trimesh.Trimesh(5 * SPACING * x * bump[:, None], made.faces)


def cup(inner: tuple[float, float, float], wall: float) -> Any:
    """Open box: its inside from the origin to `inner` [m], its walls and floor `wall` thick [m]."""
    import trimesh

    a, b, c = inner
    inside = np.array([(x, y, z) for z in (0, c) for y in (0, b) for x in (0, a)], dtype=float)
    outside = np.array(
        [(x, y, z) for z in (-wall, c) for y in (-wall, b + wall) for x in (-wall, a + wall)], dtype=float
    )
    floor, sides = (0, 2, 3, 1), ((0, 1, 5, 4), (1, 3, 7, 5), (3, 2, 6, 7), (2, 0, 4, 6))
    quads = [[8 + k for k in q] for q in (floor, *sides)] + [list(q[::-1]) for q in (floor, *sides)]
    rim = (4, 5, 7, 6)
    quads += [[8 + rim[k], 8 + rim[(k + 1) % 4], rim[(k + 1) % 4], rim[k]] for k in range(4)]
    faces = [t for q in quads for t in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))]
    return trimesh.Trimesh(np.vstack([inside, outside]), np.array(faces), process=False)


SHAPES = {
    "sphere": sphere, "torus": torus, "cube": cube, "needle": needle, "plate": plate, "funnel": funnel,
    "pebble": pebble,
}  # fmt: skip


@contextmanager
def mesh_file(made: Any) -> Iterator[str]:
    """A mesh as a file, while it is needed."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "solid.obj"
        made.export(path)
        yield str(path)
