"""Contact angles: how they are read off a drop, and the coefficient that gives one."""

import json
import math

import numpy as np
import pytest

from refsim import InputError, calibrate, calibrate_contact_angle
from validation.measure import wetting
from validation.measure.sigma_map import read_rows

WATER = {"spacing": 1e-3, "rest_density": 1000.0}


def drop(share, angle, spread=2.0, circle=None):
    return {"share": share, "angle": angle, "spread": spread, "circle": circle}


def made_up(*drops, **place):
    setting = {"dim": 3, "support": 2.6, "stiffness": 0.01, "kernels": "mueller"}
    return [{**setting, **place, "drops": list(drops)}]


MADE_UP = made_up(drop(0.0, None), drop(5.0, 120.0), drop(10.0, 90.0, circle=96.0), drop(20.0, 60.0), drop(50.0, None))


@pytest.mark.parametrize("dim, radius", [(3, 14.0), (2, 30.0)])
@pytest.mark.parametrize("angle", [30.0, 60.0, 90.0, 120.0, 150.0])
def test_both_ways_read_the_angle_of_a_cap_that_was_cut(dim, radius, angle):
    position = wetting.cap(wetting.Point(5.0, dim, radius=radius, begin=angle))
    height, count = position[:, dim - 1], len(position)
    assert wetting.angle_by_lift(height.mean() / count ** (1 / dim), dim) == pytest.approx(angle, abs=1.0)
    found, residual = wetting.angle_by_circle(height, 1.0, 1, dim)
    assert found == pytest.approx(angle, abs=1.5)
    assert residual < 0.03


def test_the_coefficient_is_interpolated_in_the_cosine_as_a_share_of_the_cohesion():
    """gamma of the effect as it acts: from its own nominal tension, in SI units."""
    found = calibrate_contact_angle(105.0, 0.072, settings=MADE_UP, **WATER)
    part = (math.cos(math.radians(105)) + 0.5) / 0.5
    assert found.share == pytest.approx(5 + 5 * part)
    assert found.uncertainty == pytest.approx(math.hypot(2.0, 3.0, 7.5 * 4 * part * (1 - part)))
    assert found.effect.gamma == calibrate(0.072, **WATER).effect.gamma
    assert found.effect.adhesion == found.adhesion
    at = calibrate_contact_angle(60.0, 0.072, settings=MADE_UP, **WATER)
    assert (at.share, at.uncertainty) == (pytest.approx(20.0), pytest.approx(math.hypot(2.0, 3.0)))
    from refsim import Cloud, Scene, WeaklyCompressible, make_plan

    found = calibrate_contact_angle(90.0, 0.072, settings=MADE_UP, **WATER)
    fluid = WeaklyCompressible(
        rest_density=1000.0, sound_speed=found.tension.sound_speed, kernels="mueller", density="summation"
    )
    scene = Scene(
        spacing=1e-3, support_radius=2.6e-3, fluid=(Cloud(position=np.zeros((1, 3))),), effects=(fluid, found.effect)
    )
    gamma = float(make_plan(scene).parameters["akinci_2013"]["spline"].gamma)
    assert found.adhesion / gamma == pytest.approx(10.0, rel=1e-5)


OUTSIDE = {
    "nan": ({"angle": math.nan}, "angle = nan is not a positive number"),
    "tension": ({"sigma": -1.0}, "sigma = -1.0 is not a positive number"),
    "above": ({"angle": 150.0}, "150 degrees is outside the map at h = 2.6 d, which has 60 to 120 degrees"),
    "below": ({"angle": 20.0}, "beyond it drops spread to a film or detach from the plane"),
    "dimension": ({"dim": 2}, "the map has no sessile drops in 2D with mueller kernels at h = 2.6 d"),
    "support": ({"support_radius": 2.8e-3}, "at h = 2.8 d and density = 'summation'; it has h/d = 2.6."),
    "no cap": ({"settings": made_up(drop(0.0, None))}, "no drop at h = 2.6 d came to rest as a cap"),
}


@pytest.mark.parametrize("name", OUTSIDE)
def test_outside_the_map_it_refuses_in_one_sentence(name):
    options, said = OUTSIDE[name]
    with pytest.raises(InputError) as refused:
        calibrate_contact_angle(**({"angle": 90.0, "sigma": 0.072, "settings": MADE_UP} | WATER | options))
    assert said in str(refused.value)
    assert str(refused.value).startswith("calibrate_contact_angle: ")
    assert str(refused.value).endswith(".")


def test_the_published_map_is_that_of_the_published_drops(tmp_path):
    wetting.write(read_rows(wetting.ROWS), tmp_path / "map.json")
    assert json.loads((tmp_path / "map.json").read_text()) == json.loads(wetting.PACKAGED.read_text())
    assert {row["key"] for row in read_rows(wetting.ROWS)} <= {point.key for point in wetting.points()}
