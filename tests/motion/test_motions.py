"""Motions: their values and derivatives, what they do to gravity and walls, and a tank that sloshes as theory says."""

import math

import msgspec
import pytest

from refsim import Box, BoxWalls, Gravity, InputError, Motion, Scene, WeaklyCompressible
from refsim import make_plan as planned
from tests.running import rows

G, DENSITY = 9.81, 1000.0
SWAY = Motion(of="gravity", kind="sway", direction=(2.0, 0.0, 0.0), amplitude=0.01, period=0.5)


def tank(cells=10, motion=(), dtype="float64", gauge=(), end_time=1.0, pull=(0.0, -G, 0.0), walls=None, **liquid):
    """Water half as deep as the tank is wide, 1 m."""
    spacing, sound = 1.0 / cells, 10 * math.sqrt(0.5 * G)
    viscosity = DENSITY * 0.01 * 0.5 * 3 * spacing * sound / 8
    return Scene(
        dim=2, dtype=dtype, spacing=spacing, support_radius=3 * spacing, motion=motion, gauge=gauge, end_time=end_time,
        fluid=(Box(cells=(cells, cells // 2, 1)),),
        effects=(
            WeaklyCompressible(sound_speed=sound, dynamic_viscosity=viscosity, viscosity="central", **liquid),
            Gravity(acceleration=pull),
            BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 0.0), model="extrapolated", **(walls or {})),
        ),
    )  # fmt: skip


@pytest.mark.parametrize(("formula", "words"), [
    ("__import__('os').system('true')", "which is not arithmetic"), ("open('x')", "unknown function 'open'"),
    ("x", "unknown name 'x'"), ("t.real", "not arithmetic"), ("t if t else 1", "not arithmetic"),
    ("[t]", "not arithmetic"), ("True", "not arithmetic"), ("sin(t, t)", "not arithmetic"), ("t +", "cannot be read"),
    ("", "is missing"), ("(" * 300 + "t" + ")" * 300, "cannot be read|nested too deeply"),
    ("-" * 999 + "t", "nested too deeply|cannot be read|not a finite|none"), ("t" * 2000, "2000 characters"),
    ("1/(t - t)", "not a finite number at 0 s"), ("log(t - 2)", "not a finite number"), ("1e3*t", "it jumps: at 0 s"),
])  # fmt: skip
def test_bad_formulas_are_refused(formula, words):
    with pytest.raises(InputError, match=words) as caught:
        planned(tank(motion=(Motion(of="gravity", kind="formula", direction=(1.0, 0.0, 0.0), formula=formula),)))
    assert str(caught.value).startswith("[[motion]] number 1: ")


@pytest.mark.parametrize(("changes", "words"), [
    ({"amplitude": None}, "'amplitude' is missing"), ({"period": 0.0}, "period = 0.0 is not possible"),
    ({"formula": "t"}, "takes no 'formula'"), ({"direction": (0.0, 0.0, 0.0)}, "is none"),
    ({"direction": (0.0, 0.0, 1.0)}, "z part in a 2D scene"), ({"amplitude": 100.0}, "it jumps"),
    ({"of": "moving_faces"}, "no face moves"),
    (
        {"kind": "table", "times": (0.0, 0.0), "values": (0.0, 1.0), "amplitude": None, "period": None}, "table jumps",
    ),
    ({"kind": "table", "times": (0.0, 1e-4), "values": (0.0, 1.0), "amplitude": None, "period": None}, "it jumps"),
    ({"kind": "table", "times": (0.0,), "values": (0.0,), "amplitude": None, "period": None}, "at least two"),
])  # fmt: skip
def test_bad_motions_are_refused(changes, words):
    with pytest.raises(InputError, match=words):
        planned(tank(motion=(msgspec.structs.replace(SWAY, **changes),)))


def test_motions_without_what_they_move_are_refused():
    across = Motion(of="moving_faces", kind="formula", direction=(0.0, 1.0, 0.0), formula="0.1*t")
    with pytest.raises(InputError, match="part across the face -y"):
        planned(tank(motion=(across,), walls={"moving_faces": ("-y",), "viscosity": 1.0}))


@pytest.mark.parametrize(("changes", "words"), rows(__file__, "bad_turns"))
def test_bad_turns_are_refused(changes, words):
    turn = Motion(of="turn", kind="sway", direction=(0.0, 0.0, 1.0), amplitude=0.1, period=1.0)
    with pytest.raises(InputError, match=words):
        planned(tank(motion=(msgspec.structs.replace(turn, **changes),)))
    with pytest.raises(InputError, match="ends of the period along x"):
        planned(tank(motion=(turn,), walls={"open_faces": ("-x", "+x")}).with_(period=(1.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="two turns"):
        planned(tank(motion=(turn, turn)))
