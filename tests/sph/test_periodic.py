"""Scenes in a periodic box: what they refuse."""

import re

import pytest

import refsim as rs
from refsim import make_plan
from tests.running import rows

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


@pytest.mark.parametrize("changes, words", [
    *rows(__file__, "bad_periods"),
    ({"effects": (LIQUID, rs.Akinci2013(surface_tension=1.0))}, "akinci_2013: this effect does not act across"),
    ({"effects": (LIQUID, rs.BoxWalls(lower=(0, 0, 0), upper=(9, 1, 0), open_faces=("-x",)))},
     "box_walls: the face +x would stand across the scene's period; add it to open_faces"),
])  # fmt: skip
def test_what_cannot_be_is_refused_in_one_sentence(changes, words):
    with pytest.raises(rs.InputError, match=re.escape(words)):
        make_plan(channel().with_(**changes))
