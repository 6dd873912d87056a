"""Scenes in a periodic box: what they refuse."""

import re

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.engine.driver import simulate
from refsim.io.results import open_run
from tests.running import advanced, rows

LIQUID = rs.WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=20.0, clamp_pressure=False, density="summation")


def channel(**options):
    """Liquid between two plates, one of which moves, in a box that is periodic along x and pushed along it."""
    given = {
        "dim": 2, "dtype": "float64", "spacing": 0.1, "support_radius": 0.26, "name": "channel",
        "period": (0.8, 0.0, 0.0), "period_lower": (-0.4, 0.0, 0.0),
        "fluid": (rs.Box(lower=(-0.4, 0.0, 0.0), cells=(8, 6, 1), velocity=(2.0, 0.0, 0.0)),),
        "effects": (
            LIQUID, rs.Gravity(acceleration=(1.0, 0.0, 0.0)),
            rs.BoxWalls(lower=(0, 0, 0), upper=(9, 0.6, 0), open_faces=("-x", "+x"), viscosity=20.0,
            moving_faces=("+y",),
                     velocity=(1.0, 0.0, 0.0)),
        ),
    }  # fmt: skip
    return rs.Scene(**(given | options))


def run(scene, steps, backend="cpu"):
    simulation = rs.Simulation(scene, backend)
    advanced(simulation, steps)
    simulation.evaluate()
    return simulation


@pytest.mark.parametrize("changes, words", [
    *rows(__file__, "bad_periods"),
    ({"effects": (LIQUID, rs.Akinci2013(surface_tension=1.0))}, "akinci_2013: this effect does not act across"),
    ({"effects": (LIQUID, rs.BoxWalls(lower=(0, 0, 0), upper=(9, 1, 0), open_faces=("-x",)))},
     "box_walls: the face +x would stand across the scene's period; add it to open_faces"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_one_sentence(changes, words):
    with pytest.raises(rs.InputError, match=re.escape(words)):
        make_plan(channel().with_(**changes))


def test_the_walls_of_a_channel_go_once_around():
    plan = make_plan(channel())
    for side in (-0.05, 0.65):
        x = np.sort(plan.walls.position[np.isclose(plan.walls.position[:, 1], side), 0])
        assert np.allclose(x, -0.35 + 0.1 * np.arange(8))
    assert np.ptp(plan.walls.volume) < 1e-12
    assert np.isinf(plan.shared["bounds"].lower[0])


def test_frames_hold_the_images_in_the_box(tmp_path):
    scene = channel(fluid=(rs.Box(lower=(-0.4, 0.0, 0.0), cells=(8, 6, 1), velocity=(40.0, 0.0, 0.0)),), end_time=0.02)
    simulate(scene, backend="numpy", output=tmp_path / "run")
    found = open_run(tmp_path / "run")[-1]["position"]
    assert (np.abs(found[:, 0]) <= 0.4).all()
    assert np.ptp(found[:, 0]) > 0.6  # the box is full
