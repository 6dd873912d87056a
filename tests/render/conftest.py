"""Runs that the tests draw, written by `refsim run` itself."""

import pytest

from refsim import Ball, Box, BoxWalls, Gravity, MeshBoundary, Scene, WeaklyCompressible, simulate

LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, density="summation")


@pytest.fixture(scope="session")
def in_plane(tmp_path_factory):
    """Four frames of a column in a tank, in 2D; y is up."""
    scene = Scene(
        dim=2, spacing=0.01, support_radius=0.026, end_time=0.06, name="column",
        fluid=(Box(cells=(8, 16, 1)), Box(lower=(0.3, 0.0, 0.0), cells=(6, 6, 1))),
        effects=(
            LIQUID, Gravity(acceleration=(0.0, -9.81, 0.0)),
            BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.4, 0.3, 0.0), open_faces=("+y",)),
        ),
    )  # fmt: skip
    return run(scene, tmp_path_factory.mktemp("plane") / "run", 0.02)


@pytest.fixture(scope="session")
def in_space(tmp_path_factory):
    """Three frames of a drop that falls on a cube, in 3D."""
    import trimesh

    folder = tmp_path_factory.mktemp("space")
    trimesh.creation.box((0.1, 0.1, 0.1)).export(folder / "cube.stl")
    scene = Scene(
        spacing=0.02, support_radius=0.05, end_time=0.02, name="drop <on> a cube",
        fluid=(Ball(center=(0.0, 0.0, 0.16), radius=0.07, velocity=(0.0, 0.0, -1.0)),),
        effects=(LIQUID, Gravity(), MeshBoundary(file=str(folder / "cube.stl"))),
    )  # fmt: skip
    return run(scene, folder / "run", 0.01)


def run(scene, folder, every):
    simulate(scene, output=folder, every=every, backend="numpy")
    return folder
