"""Meshes that particles are spread over, about 2 m across, and distances that are known in closed form."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from refsim.core.writing import write_file
from refsim.scene.surface_mesh import SurfaceMesh, surface_mesh

TORUS = (1.0, 0.35)  # radii of the ring and of its tube [m]
CUBE = 1.0  # side [m]
PLATE = (1.6, 1.2, 0.1)  # [m]
NEEDLE = (0.12, 2.0)  # radius and length of a cone [m]
TILT = 0.5  # rad, so that no face lies along the grid


def make(kind: str, *given: Any, **named: Any) -> Any:
    """A mesh of `trimesh.creation`."""
    import trimesh

    return getattr(trimesh.creation, kind)(*given, **named)


def turned(made: Any, angle: float, axis: tuple[float, float, float]) -> Any:
    """Turned [rad] about an axis through the origin."""
    import trimesh

    return made.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))


def organic(level: int = 5) -> Any:
    """A ball with lobes and hollows: its radius follows a few waves."""
    made = make("icosphere", level)
    x, y, z = np.array(made.vertices).T
    radius = 1 + 0.22 * np.sin(3 * x + 1) * np.cos(2 * y) + 0.15 * np.sin(4 * z + 2 * y) + 0.08 * np.cos(7 * x * y)
    made.vertices = np.array(made.vertices) * radius[:, None]
    return made


def tilted(made: Any) -> Any:
    """Turned by TILT about a direction along no axis."""
    return turned(made, TILT, (1.0, 0.7, 0.2))


SHAPES: dict[str, Callable[..., Any]] = {  # by the level of refinement
    "sphere": lambda level=5: make("icosphere", level),
    "torus": lambda level=5: make(
        "torus", *TORUS, major_sections=6 * 2**level // 2, minor_sections=3 * 2**level // 2
    ),
    "cube": lambda level=5: tilted(make("box", (CUBE,) * 3)),
    "needle": lambda level=5: tilted(make("cone", *NEEDLE, sections=64)),  # its tip has 7 degrees
    "plate": lambda level=5: tilted(make("box", PLATE)), "organic": organic,
}  # fmt: skip


def mesh_of(made: Any, name: str = "mesh") -> SurfaceMesh:
    """What trimesh holds, as refsim takes it."""
    return surface_mesh(made.vertices, made.faces, name)


# Meshes that liquid falls on, lies in and runs through; lengths in metres, made anew for every run.


SPACING = 0.01  # of the liquid [m]
SUPPORT = 2.7 * SPACING


def funnel() -> Any:
    """Cone from 10 spacings down to a spout of 2.6, its wall 1.5 thick."""
    line = np.array([[2.6, -8], [4.1, -8], [4.1, -4.5], [11.5, 4], [10, 4], [2.6, -4]]) * SPACING
    made = make("revolve", np.vstack([line, line[:1]]), sections=40)
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


FLOW_SHAPES: dict[str, Callable[[], Any]] = {
    "sphere": lambda: make("icosphere", subdivisions=3, radius=5 * SPACING),
    "torus": lambda: make("torus", 6 * SPACING, 2.2 * SPACING, major_sections=48, minor_sections=24),
    "cube": lambda: turned(make("box", (8 * SPACING,) * 3), np.pi / 4, (1, 0, 0)),  # on an edge
    "needle": lambda: make("cone", 1.5 * SPACING, 16 * SPACING, sections=16).apply_translation((0, 0, -8 * SPACING)),
    "plate": lambda: make("box", (12 * SPACING, 12 * SPACING, SPACING)), "funnel": funnel, "pebble": pebble,
}  # fmt: skip


@contextmanager
def mesh_file(made: Any) -> Iterator[str]:
    """A mesh as a file, while it is needed."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "solid.obj"
        write_file(path, made.export(file_type="obj"))
        yield str(path)
