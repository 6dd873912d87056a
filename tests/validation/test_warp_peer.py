"""Warp as a peer computes what refsim computes."""

import msgspec
import numpy as np
import pytest

from refsim import Akinci2013, Box, Cloud, JiangZhu2023, Scene, Simulation, WeaklyCompressible, make_plan
from validation import peers
from validation.peers import warp_sph

EDGE, SPACING, STEP = 6, 1 / 6, 1e-3
LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=1.0, density="summation")
COHESION = JiangZhu2023(surface_tension=0.5, pair_mode="all", area_ratio=0.0, density_correction=False)


def plan(dtype="float32"):
    """Particles beside the points of a lattice that turn: no term of the acceleration cancels."""
    steps = (np.arange(EDGE) + 0.5) * SPACING
    place = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    place += np.random.default_rng(1).uniform(-0.2, 0.2, place.shape) * SPACING
    place = place.astype(np.float32).astype(float)
    velocity = np.cross([0.0, 0.0, 1.0], place - 0.5).astype(np.float32).astype(float)
    fluid = (Cloud(position=place, velocity=velocity),)
    return make_plan(
        Scene(
            dtype=dtype, spacing=SPACING, support_radius=2 * SPACING, step=STEP, fluid=fluid, effects=(LIQUID, COHESION)
        )
    )


@pytest.mark.skipif(bool(peers.missing("warp_sph")), reason=peers.missing("warp_sph"))
def test_the_same_accelerations_and_the_same_motion():
    peer = warp_sph.run(plan(), STEP, warm=2, steps=7, every=3, accelerations=True)
    assert "missing" not in peer, peer
    oracle, own = Simulation(plan("float64"), "numpy"), Simulation(plan(), "cpu", threads=1)
    for simulation in (oracle, own):
        simulation.evaluate()
    true = oracle.field("acceleration")
    error = [np.abs(a - true).max() / np.abs(true).max() for a in (own.field("acceleration"), peer["acceleration"])]
    # Both add about 30 terms whose sum is smaller than they are, in different orders.
    assert error[0] < 3e-6
    assert error[1] < 3e-6
    for _ in range(1 + 2 + 7):
        own.step()
    speed = np.sqrt((own.field("velocity").astype(float) ** 2).sum(1).mean())
    assert peer["speed"] == pytest.approx(speed, rel=1e-5)
    assert peer["centre"] == pytest.approx(own.field("position").astype(float).mean(0), abs=1e-6)
    assert set(peer["seconds"]) == {"each step", "with skin"}


@pytest.mark.parametrize("change", ["tension", "state", "kernels"])
def test_another_scene_is_refused(change):
    effects = {
        "tension": (LIQUID, Akinci2013(surface_tension=0.5)),
        "state": (msgspec.structs.replace(LIQUID, state="tait"), COHESION),
        "kernels": (msgspec.structs.replace(LIQUID, kernels="mueller"), COHESION),
    }[change]
    scene = Scene(spacing=0.1, support_radius=0.2, fluid=(Box(cells=(3, 3, 3)),), effects=effects)
    with pytest.raises(ValueError, match="Warp's program"):
        warp_sph.coefficients(make_plan(scene))


def test_left_out_with_its_reason(monkeypatch):
    monkeypatch.setitem(peers.PROGRAMS, "warp_sph", ("Warp", "no_such_module", "warp-lang"))
    reason = "warp-lang is not installed; run pip install warp-lang"
    assert warp_sph.run(plan(), STEP, 1, 1, 1) == {"missing": reason}
