"""Liquids that break codes: few particles, particles at one place, unequal masses, spray.

Hard cases that need a flow or a bisection are checks of experiments (`python -m validation check`). Kills and full
disks stand in `test_run.py`, drops far from the origin in `test_far_away.py`.
"""

import numpy as np
import pytest

import refsim as rs
from refsim import WeaklyCompressible as Liquid
from refsim.engine.conserved_totals import check_particles
from refsim.io.checkpoint import read_checkpoint, write_checkpoint
from tests.running import advanced, run_to

D, H, SOUND, DENSITY = 0.01, 0.026, 20.0, 1000.0  # [m], [m], [m/s], [kg/m^3]
TENSION = rs.JiangZhu2023(surface_tension=0.03 * DENSITY * SOUND**2 * H / 7.8)  # internal pressure 0.03 rho0 c^2
ROUNDINGS = 32 * 1.2e-7  # of float32, over sum of m |v|


def liquid(fluid, *effects, viscosity=0.5, **changes):
    own = Liquid(
        rest_density=DENSITY, sound_speed=SOUND, dynamic_viscosity=viscosity, kernels="wendland", density="summation"
    )
    parts = fluid if isinstance(fluid, tuple) else (fluid,)
    return rs.Scene(**{"spacing": D, "support_radius": H, "fluid": parts, "effects": (own, *effects), **changes})


def block(n):
    return D * (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3) + 0.5)


def sound(scene, steps):
    """A run after some steps: no particle lost, all finite, no neighbour missed."""
    run = scene if isinstance(scene, rs.Simulation) else rs.Simulation(scene)
    advanced(run, steps)
    check_particles(run)
    assert run.search is None or run.search.log.missed_neighbours == 0
    return run


def momentum(run):
    mass, velocity = run.field("mass").astype(float)[:, None], run.field("velocity").astype(float)
    return (mass * velocity).sum(0), float((mass[:, 0] * np.linalg.norm(velocity, axis=1)).sum())


def fastest(run):
    return float(np.linalg.norm(run.field("velocity").astype(float), axis=1).max())


def test_particles_that_meet_at_one_place_in_a_run_part_slowly_and_keep_momentum(tmp_path):
    run = sound(liquid(rs.Box(cells=(6, 6, 6)), TENSION), 5)
    run.checkpoint(tmp_path / "edited.h5")
    saved = read_checkpoint(tmp_path / "edited.h5")
    x = saved.arrays["field.position"]
    j = int(np.argsort(np.linalg.norm(x - x[100], axis=1))[1])
    for name in ("field.position", "build_position", "field.velocity"):
        saved.arrays[name][j] = saved.arrays[name][100]
    write_checkpoint(tmp_path / "edited.h5", saved.arrays, saved.attributes)
    edited = rs.Simulation.resume(tmp_path / "edited.h5")
    before, _ = momentum(edited)
    after, scale = momentum(sound(edited, 200))
    assert np.linalg.norm(after - before) <= ROUNDINGS * scale
    assert fastest(edited) <= 0.5 * SOUND


@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_a_few_particles_fall_freely_and_are_all_surface(count):
    points = D * np.array([[0.0, 0, 0], [0.4, 0, 0], [0.2, 0.5, 0], [0.1, 0.2, 0.6]])[:count]
    run = sound(liquid(rs.Cloud(position=points), rs.Gravity(), TENSION, rs.SurfaceDetection(each_step=True)), 300)
    run.evaluate()
    reached = -9.81 * (run.time - run.last.length / 2)  # velocities are half a step behind
    assert run.field("velocity")[:, 2].astype(float).mean() == pytest.approx(reached, rel=1e-4)
    assert run.field("surface").sum() == count
    sideways = run.field("position").astype(float).mean(0) - points.mean(0)
    assert np.abs(sideways[:2]).max() <= 1e-3 * D


def test_particles_almost_at_one_place_move_in_float64_and_are_refused_in_float32():
    points = block(4)
    points = np.vstack([points, points[21] + [1e-12 * D, 0, 0], [[1.0, 0, 0]], [[1.0 + 1e-12 * D, 0, 0]]])
    run = sound(rs.Simulation(liquid(rs.Cloud(position=points), TENSION, dtype="float64"), "numpy"), 100)
    total, scale = momentum(run)
    assert np.linalg.norm(total) <= 32 * 2.3e-16 * scale
    assert fastest(run) <= 0.5 * SOUND
    with pytest.raises(rs.InputError):
        rs.make_plan(liquid(rs.Cloud(position=points), TENSION, dtype="float32"))


@pytest.mark.parametrize("heavy", ["one", "half"])
def test_masses_of_1000_to_1_stop_by_name_or_stay_slow(heavy):
    """J(7) makes the neighbours of one heavy particle hundreds of times too dense; half a block of light ones lasts."""
    points = block(8)
    mass = np.full(len(points), DENSITY * D**3)
    mass[219 if heavy == "one" else points[:, 0] > points[:, 0].mean()] *= 1000 if heavy == "one" else 1e-3
    run = rs.Simulation(liquid(rs.Cloud(position=points, mass=mass)))
    if heavy == "one":
        with pytest.raises(rs.RunStopped) as stopped:
            run_to(run, 0.05)
        assert stopped.value.reason == "compressed"
        return
    run_to(run, 0.05)
    total, scale = momentum(run)
    assert np.linalg.norm(total) <= ROUNDINGS * scale
    energy = 0.5 * float((run.field("mass") * (run.field("velocity").astype(float) ** 2).sum(1)).sum())
    assert energy <= 0.05 * mass.sum() * SOUND**2


@pytest.mark.parametrize(("dim", "dtype"), [(2, "float32"), (2, "float64"), (3, "float32")])
def test_planes_end_at_an_open_face_but_at_an_open_top(dim, dtype):
    """One falls off the floor, not under it, and none onto it from below; the wall holds another above the open top."""
    up = dim - 1
    places, corner = np.full((3, 3), 0.05), np.full(3, 0.1)
    places[:, [0, up]] = [[0.09, 0.005], [0.11, 0.0], [0.01, 0.15]]
    places[:, dim:] = 0.0
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=tuple(corner), open_faces=("+x", "+" + "xyz"[up]))
    cloud = rs.Cloud(position=places, velocity=[[1.0, 0.0, 0.0], [-0.15, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    scene = rs.Scene(
        dim=dim, dtype=dtype, spacing=D, support_radius=H, fluid=(cloud,),
        effects=(Liquid(sound_speed=SOUND), rs.Gravity(), walls),
    )  # fmt: skip
    x = run_to(rs.Simulation(scene, "numpy"), 0.12).field("position")
    assert x[:2, up].max() < -0.035
    assert x[:2, 0].min() > 0.15
    assert 0.0 <= x[2, 0] < D
