"""Material points: the grid's memory, what is slow, and crowding where they are strewn at random."""

import numpy as np
import pytest

import refsim as rs
from refsim.mpm import Counting
from refsim.surface_energy.effect import CROWDED, OVERFULL
from tests.running import advanced
from validation.metrics.mpm import CELL, DENSITY, Transfers

CUBES = {2: (8, 8, 1), 3: (5, 5, 5)}


def grid_after(dim, *places, velocity=(0.0, 0.0, 0.0), steps=1):
    """The grid of blobs that begin at these x, after some steps."""
    blobs = (rs.Box(lower=(0.03 + x, 0.05, 0.07), cells=CUBES[dim], velocity=velocity) for x in places)
    scene = rs.Scene(
        spacing=0.1, support_radius=0.3, dim=dim, fluid=tuple(blobs), effects=(rs.MpmLiquid(bulk_modulus=1e5),)
    )
    return advanced(rs.Simulation(scene), steps).parameters["mpm_liquid"]["grid"]


@pytest.mark.parametrize("dim", [2, 3])
def test_grid_follows_the_liquid(dim):
    """Two blobs a million cells apart cost twice one blob, and a blob that flies on leaves no blocks behind."""
    alone = grid_after(dim, 0.0).nodes
    assert grid_after(dim, 0.0, 0.2 * 2**19).nodes == 2 * alone
    flying = grid_after(dim, 0.0, velocity=(40.0, 0.0, 0.0), steps=150)
    assert flying.rebuilds > 3
    assert flying.nodes <= 3 * alone


def test_nothing_ahead_of_the_sound_is_subnormal():
    """A long block, pushed at one end: what processors compute with slowly does not arise in it."""
    blocks = rs.Box(cells=(10, 8, 1), velocity=(1.0, 0.0, 0.0)), rs.Box(lower=(1.0, 0.0, 0.0), cells=(250, 8, 1))
    scene = rs.Scene(
        spacing=0.1, support_radius=0.3, dim=2, fluid=blocks, effects=(rs.MpmLiquid(bulk_modulus=1e5),), dtype="float32"
    )
    run = advanced(rs.Simulation(scene), 60)
    sizes = np.abs(np.concatenate([run.field(name).ravel() for name in ("velocity", "affine")]))
    assert (sizes[sizes > 0] >= np.finfo(np.float32).tiny).all()
    assert np.count_nonzero(run.field("velocity")[:, 0]) > 500


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_water_falls_in_microgravity(dtype):
    """With 1 um/s^2 and the sound speed of water a step adds 4e-14 m/s."""
    effects = rs.MpmLiquid(bulk_modulus=2.2e9), rs.Gravity(acceleration=(0.0, -1e-6, 0.0))
    drop = rs.Box(cells=(8, 8, 1))
    scene = rs.Scene(spacing=1e-4, support_radius=3e-4, dim=2, fluid=(drop,), effects=effects, dtype=dtype)
    run = advanced(rs.Simulation(scene), 10)
    np.testing.assert_allclose(run.field("velocity")[:, 1], -1e-6 * run.time, rtol=1e-5)


def strewn(dim, shares):
    """Crowding of a cube of particles strewn at random, each within its own share of the volume or anywhere."""
    count = 150 if dim == 2 else 34
    axes = np.meshgrid(*[np.arange(float(count))] * dim, indexing="ij")
    lattice = np.stack(axes, axis=-1).reshape(-1, dim)
    random = np.random.default_rng(9)
    place = lattice + {"lattice": 0.3, "own": random.uniform(size=lattice.shape)}.get(shares, 0.0)
    if shares == "any":
        place = random.uniform(0, count, lattice.shape)
    frame = np.linalg.qr(random.normal(size=(dim, dim)))[0]
    position = np.pad(0.5 * CELL * (place - count / 2) @ frame, ((0, 0), (0, 3 - dim)))
    full = DENSITY * (CELL / 2) ** dim
    spread = Transfers(position, 0 * position, np.zeros((len(place), 9)), mass=np.full(len(place), full), dim=dim)
    spread.values |= {"counting": Counting(DENSITY * CELL**dim), "greatest_crowding": np.zeros(1)}
    spread.values |= {"crowding": np.zeros(len(place))}
    spread.to_grid()
    spread.run("mpm.count")
    found = spread.values["crowding"]
    assert found.max() == spread.values["greatest_crowding"][0]
    return found[(abs(place - count / 2) < count / 2 - 5).all(1)]


@pytest.mark.slow
@pytest.mark.parametrize("dim", [2, 3])
def test_crowding_of_particles_strewn_at_random(dim):
    """Where the limits of crowding come from: a lattice has 1; what lies in shares of its own stays below CROWDED, what
    lies anywhere below OVERFULL."""
    assert abs(strewn(dim, "lattice") - 1).max() < 1e-3
    own, anywhere = strewn(dim, "own"), strewn(dim, "any")
    assert own.max() < 1.2 < CROWDED < anywhere.max() < OVERFULL
    assert own.mean() + own.std() < 1.05 < own.max()
