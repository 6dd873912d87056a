"""`refsim plan` says how far a scene's settings are from the measured limits; beyond them stand notes."""

import math
import re

import msgspec
import pytest

import refsim as rs
from refsim.commands.plan import _text, describe_plan
from refsim.scene.plan import make_plan
from refsim.surface_tension import akinci_2013
from refsim.surface_tension.dong_2016 import LARGEST_CORRECTION
from refsim.surface_tension.jiang_zhu_2023 import LARGEST_AREA

D = 0.01
LIQUID = rs.WeaklyCompressible(sound_speed=10.0, dynamic_viscosity=2.0, viscosity="central", density="summation")
AREA = LARGEST_AREA["corrected"][LIQUID.kernels]
NEAR = 4 * math.pi / 3 * 2.6**3  # neighbours in the support


def scene(*effects, support=2.6, **more):
    return rs.Scene(
        spacing=D, support_radius=support * D, fluid=(rs.Box(cells=(4, 4, 4)),), effects=effects, end_time=0.1, **more
    )  # fmt: skip


def found(*effects, **more):
    """(margins by setting, notes) of a scene."""
    told = describe_plan(make_plan(scene(*effects, **more)), "cpu")
    return {m["setting"]: m for m in told["margins"]}, told["notes"]


CASES = {  # setting: (effects of a scene by the value's factor, words of the note)
    "dynamic_viscosity [Pa s]": (
        lambda x: (msgspec.structs.replace(LIQUID, dynamic_viscosity=x * 1000 * 10 * 2.6 * D / 250),),
        "kinetic energy may grow",
    ),
    "area_ratio": (
        lambda x: (LIQUID, rs.JiangZhu2023(surface_tension=0.07, area_term="corrected", area_ratio=x * AREA)),
        "area_ratio =",
    ),
    "sigma/(rho0 c^2 d)": (
        lambda x: (LIQUID, rs.CsfWang2019(surface_tension=0.015 * x * 1000 * 100 * D)),
        "sigma/(rho0 c^2 d) =",
    ),
    "area_acceleration/(gamma rho0)": (
        lambda x: (LIQUID, rs.Akinci2013(gamma=1.0, area_acceleration=x * akinci_2013.LARGEST_AREA * 1000 / NEAR)),
        "a shorter step does not help",
    ),
    "correction rho0 d/sigma": (
        lambda x: (LIQUID, rs.Dong2016(surface_tension=0.07, correction=x * LARGEST_CORRECTION * 0.07 / 10)),
        "a shorter step does not help",
    ),
}
# of the values at twice the limit for a largest, half of it for a least
LEAST = {"dynamic_viscosity [Pa s]"}


@pytest.mark.parametrize("setting", list(CASES))
def test_a_note_is_given_beyond_a_limit_and_only_there(setting):
    make, words = CASES[setting]
    within, beyond = (2.0, 0.5) if setting in LEAST else (0.5, 2.0)
    for factor in (within, beyond):
        margins, notes = found(*make(factor))
        margin = margins[setting]["factor"]
        assert (margin < 1) == any(words in note for note in notes), (factor, notes)
        assert margin == pytest.approx(2.0 if factor == within else 0.5)


def test_a_fixed_step_gauges_and_motions_are_listed():
    margins, _ = found(LIQUID)
    assert "step [s]" not in margins
    told = describe_plan(make_plan(scene(LIQUID)), "cpu")
    stable = min(told["step"]["limits"].values())
    told = describe_plan(make_plan(scene(LIQUID, step=1.25 * stable)), "cpu")
    (margin,) = [m for m in told["margins"] if m["setting"] == "step [s]"]
    assert margin["factor"] == pytest.approx(0.8)
    text = _text(told)
    assert "beyond, 1.2 times" in text
    assert "Measured limits (docs/stability.md)" in text
    made = scene(LIQUID, rs.Gravity(), rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(0.1, 0.1, 0.1)))
    gauge = rs.Gauge(name="floor", kind="force", on="-y", every=0.01)
    sway = rs.Motion(of="gravity", kind="sway", direction=(1.0, 0.0, 0.0), amplitude=0.01, period=0.5)
    changed = made.with_(gauge=(gauge,), motion=(sway,))
    told = describe_plan(make_plan(changed), "cpu")
    assert told["gauges"] == [{"name": "floor", "kind": "force", "every": 0.01, "instants": 0, "on": "-y"}]
    assert told["motions"][0]["amplitude"] == 0.01
    assert re.search(r"Gauges\n.*\n.*\n? *floor +force +0.01 +0 +-y", _text(told))
    assert re.search(r"Motions\n.*\n.*\n? *gravity +sway +1, 0, 0 +0.01 +0.5", _text(told))
    assert "Gauges" not in _text(describe_plan(make_plan(made), "cpu"))
