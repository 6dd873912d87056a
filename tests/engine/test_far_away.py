"""Scenes far from the origin: slow motion, forces and all that names a place are as in the same scene at the origin."""

import numpy as np
import pytest
import trimesh

import refsim as rs
from refsim import open_run, simulate
from refsim.study.observables import observable_of
from tests.running import advanced

D, C = 0.01, 10.0
LIQUID = rs.WeaklyCompressible(sound_speed=C, dynamic_viscosity=2.0, density="summation")
FAR = 1_000_000


def block(at, velocity=(0.0, 0.0, 0.0), cells=(6, 6, 6), dim=3, **changes):
    """A block whose middle is `at` [spacings]."""
    cells = (*cells[:2], cells[2] if dim == 3 else 1)
    low = tuple((x - 0.5 * n) * D if axis < dim else 0.0 for axis, (x, n) in enumerate(zip(at, cells)))
    given = {"spacing": D, "support_radius": 2.6 * D, "dim": dim, "effects": (LIQUID,)} | changes
    return rs.Scene(fluid=(rs.Box(lower=low, cells=cells, velocity=velocity),), **given)


def place(simulation):
    """Positions in float64, with what rounding took from them."""
    position = simulation.field("position")
    rest = simulation.field("position_residual") if position.dtype == np.float32 else 0.0
    return position.astype(float) + rest


@pytest.mark.parametrize("dim, far, mach, backend", [
    (2, 1_000, 1e-4, "numpy"), (2, FAR, 1e-5, "cpu"), (3, -10_000, 1e-5, "numpy"), (3, FAR, 1e-5, "numpy"),
])  # fmt: skip
def test_a_slow_block_moves_by_its_velocity(dim, far, mach, backend):
    velocity = (mach * C, -0.5 * mach * C, 0.0)
    simulation = rs.Simulation(block((far, 0.3 * far, -far * (dim == 3)), velocity, dim=dim), backend)
    start = simulation.field("position")
    advanced(simulation, 60 if backend == "cpu" else 10)
    assert start.dtype == np.float64
    moved = simulation.field("position") - start
    assert moved.mean(0) == pytest.approx(simulation.time * np.array(velocity), rel=1e-4, abs=1e-6 * mach * C)
    assert np.ptp(moved, axis=0).max() < 0.01 * simulation.time * mach * C


def walls(at, reach, **changes):
    low, high = ([(x + side * reach) * D for x in at] for side in (-1, 1))
    return rs.BoxWalls(lower=tuple(low), upper=tuple(high), **changes)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    """A ball in a file whose numbers are far from 0, too."""
    made = trimesh.creation.icosphere(subdivisions=2, radius=3 * D)
    made.apply_translation((FAR * D, 0.0, -FAR * D))
    path = tmp_path_factory.mktemp("meshes") / "ball.ply"
    made.export(path, vertex_normal=False)
    return str(path)


def jittered(at, dim, **changes):
    """A cloud out of its lattice, denser than at rest, around `at` [spacings]."""
    cells = np.stack(np.meshgrid(*[np.arange(-3, 3)] * dim, indexing="ij"), -1).reshape(-1, dim)
    points = np.zeros((len(cells), 3))
    points[:, :dim] = 0.95 * (cells + 0.5) + np.random.default_rng(3).uniform(-0.15, 0.15, cells.shape)
    velocity = np.random.default_rng(4).normal(size=points.shape) * 0.02 * C * (np.arange(3) < dim)
    given = {"spacing": D, "support_radius": 2.6 * D, "dim": dim, "effects": (LIQUID,)} | changes
    return rs.Scene(fluid=(rs.Cloud(position=(points + at) * D, velocity=velocity),), **given)


PULL = rs.Gravity(acceleration=(0.0, -9.81, 0.0))


def scenes(kind, at, ball=None):
    """A scene of a kind, around `at` [spacings]."""
    at = np.array(at, dtype=float)
    low = tuple((at - 6.0) * D)
    if kind == "walls":
        friction = {"viscosity": 0.5, "moving_faces": ("-y",), "velocity": (0.3, 0.0, 0.0)}
        return jittered(at - [0, 2, 0], 2, effects=(LIQUID, PULL, walls(at, 5.2, **friction)))
    if kind == "tension":
        return jittered(at, 3, effects=(LIQUID, rs.JiangZhu2023(surface_tension=0.1)))
    if kind == "period":
        lengths = {"period": (12 * D, 0, 0), "period_lower": (low[0], 0.0, 0.0)}
        open_faces = {"open_faces": ("-x", "+x", "-z", "+z")}
        return jittered(at + [3, 0, 0], 2, effects=(LIQUID, PULL, walls(at, 4.0, **open_faces)), **lengths)
    if kind == "mesh":
        center = None if ball is not None and at[0] else tuple(at * D)
        above = rs.MeshBoundary(file=ball, center=center, size=6 * D, viscosity=0.1)
        return jittered(at + [0.4, 7, 0.3], 3, effects=(LIQUID, PULL, above))
    if kind == "mpm":
        tension = rs.SurfaceEnergy(surface_tension=1.0)
        liquid = rs.MpmLiquid(bulk_modulus=1000 * C**2)
        box = rs.MpmWalls(lower=low, upper=tuple((at + 6) * D))
        return jittered(at - [0, 2, 0], 2, effects=(liquid, PULL, box, tension))
    assert kind == "solid"
    body = rs.SolidBox(lower=tuple((at - [3, 0, 2]) * D), upper=tuple((at + [1, 3, 2]) * D), spin=(0.0, 1.0, 2.0))
    cells = rs.SolidCells(
        cells=(at + [[3, 0, 0], [3, 1, 0], [4, 0, 0], [3, 0, 1]]).astype(int), velocity=(-0.1, 0.0, 0.0)
    )
    return block(at - [0, 4, 0], cells=(6, 4, 6), solid=(body, cells), effects=(
        LIQUID, PULL, rs.ShapeMatching(), rs.TwoWayCoupling(), rs.HeatConduction(temperature=20.0), walls(at, 7.0),
    ))  # fmt: skip


@pytest.mark.parametrize("kind", ["walls", "tension", "period", "mesh", "mpm", "solid"])
def test_a_scene_far_away_is_the_scene_at_the_origin(kind, ball):
    at = (FAR, 0, 0 if kind in ("walls", "period", "mpm") else -FAR)
    near, far = (rs.Simulation(scenes(kind, where, ball), "numpy") for where in ((0, 0, 0), at))
    assert any(far.plan.grid.origin)
    assert near.plan.fields == far.plan.fields
    for step in range(21):
        if step % 10 == 0:
            assert place(far) - np.array(at) * D == pytest.approx(place(near), abs=2e-3 * D)
        if step == 0:
            for simulation in (near, far):
                simulation.evaluate()
            for name in {"density", "acceleration"} & set(near.plan.fields):
                size = float(np.abs(near.field(name)).max())
                assert far.field(name) == pytest.approx(near.field(name), abs=1e-4 * size), name
        near.step()
        far.step()
    assert far.field("velocity") == pytest.approx(near.field("velocity"), abs=2e-3 * C)
    assert far.stopped_at_walls == near.stopped_at_walls


# What leaves
def test_frames_reports_and_observables_are_places_in_the_scene(tmp_path):
    at = np.array([FAR, FAR, 0])
    simulation = rs.Simulation(scenes("walls", at), "numpy")
    report = simulate(simulation, until=5e-3, output=tmp_path / "run", every=1e-3)
    assert report.ledger["end"]["outside_walls"] == 0
    run = open_run(tmp_path / "run")
    assert run[-1].position.dtype == np.float64
    assert np.array_equal(run[-1].sorted().position, simulation.field("position"))
    assert "position_residual" not in run.fields
    assert np.abs(simulation.field("position") / D - at).max() < 6
    low = simulation.plan.effects["box_walls"].lower
    assert simulation.plan.walls.position.min(0)[:2] == pytest.approx(np.array(low[:2]) - 0.5 * D, abs=1e-6 * D)
    front = observable_of("front:+x", simulation.plan)
    assert front(simulation) == pytest.approx(simulation.field("position")[:, 0].max() + 0.5 * D)
