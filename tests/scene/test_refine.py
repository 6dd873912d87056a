"""The same scene at another spacing, or without an effect."""

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.scene.refine import refined, resting_step, spaced, without

LIQUID = rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2.0, density="summation")


def scene_of(**more):
    given = {
        "spacing": 0.01, "support_radius": 0.026, "fluid": (rs.Box(cells=(20, 40, 1)),), "dim": 2, "effects": (LIQUID,),
    }  # fmt: skip
    return rs.Scene(**(given | more))


def test_a_box_keeps_its_edges_and_its_density():
    """Between levels, and where another number of cells is written for the same edges."""
    scene = scene_of(fluid=(rs.Box(lower=(0.1, 0.0, 0.0), cells=(30, 41, 1)),), dtype="float64")
    for made in (refined(scene, 1.3), refined(refined(scene, 1.3), 1.17)):
        box = made.fluid[0]
        assert box.size[:2] == pytest.approx((0.3, 0.41))
        simulation = rs.Simulation(made, "numpy")
        x, half = simulation.field("position"), 0.5 * np.divide(box.size, box.cells)
        assert x.min(0)[:2] - half[:2] == pytest.approx([0.1, 0.0])
        assert x.max(0)[:2] + half[:2] == pytest.approx([0.4, 0.41])
        simulation.evaluate()
        middle = np.linalg.norm(x - x.mean(0), axis=1) < 0.1
        assert simulation.field("density")[middle].mean() == pytest.approx(1000.0, rel=0.002)
    far = scene_of(fluid=(rs.Box(cells=(30, 41, 1), size=(0.4, 0.41, 0.01)),))
    with pytest.raises(
        rs.InputError, match=r"at 1.33, 1 spacings along the axes; give 0.91 to 1.1, or leave the size out"
    ):
        make_plan(far)


def test_a_fixed_step_follows_what_is_stable_and_clouds_have_no_other_spacing():
    """Sound: as the spacing. Diffusion: as its square."""
    sound = scene_of(step=1e-5)
    assert refined(sound, 2.0).step == pytest.approx(5e-6)
    still = scene_of(step=1e-5, effects=(rs.Gravity(acceleration=(0.0, -9.81, 0.0)),))  # which limits no step
    assert refined(still, 2.0).step == pytest.approx(5e-6)
    thick = scene_of(
        step=1e-5, effects=(rs.WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=2e5, density="summation"),)
    )
    ratio = resting_step(thick, 0.005, 0.013) / resting_step(thick, 0.01, 0.026)
    assert (ratio, refined(thick, 2.0).step) == (pytest.approx(0.25, rel=1e-6), pytest.approx(0.25e-5))
    cloud = scene_of(fluid=(rs.Box(cells=(4, 4, 1)), rs.Cloud(position=[[1.0, 1.0], [1.0, 1.01]])))
    cells = scene_of(solid=(rs.SolidCells(cells=[[0, 0, 0]]),))
    for scene, words in ((cloud, r"\[\[fluid\]\] number 2 gives its particles"), (cells, r"\[\[solid\]\] number 1")):
        with pytest.raises(rs.InputError, match=words):
            refined(scene, 2.0)
        with pytest.raises(rs.InputError, match=words):
            spaced(scene, 3, 1)


TENSIONS = (
    rs.Akinci2013(surface_tension=0.1), rs.JiangZhu2023(surface_tension=0.1), rs.CsfWang2019(surface_tension=0.1),
    rs.He2014(surface_tension=0.1), rs.NormalDifference2014(area_acceleration=1.0),
)  # fmt: skip
OF_DROPS = ("continuity", "summation", "continuity", "summation", "summation")
LEFT_OUT = [
    *((tension, None, density) for tension, density in zip(TENSIONS, OF_DROPS, strict=True)),
    *((tension, "continuity", "continuity") for tension in TENSIONS),
    (rs.ImplicitPressure(), None, "summation"), (rs.Gravity(acceleration=(0.0, -9.81, 0.0)), None, "continuity"),
]  # fmt: skip


@pytest.mark.parametrize(("left_out", "given", "density"), LEFT_OUT)
def test_what_is_left_out_decides_for_the_rest_all_the_same(left_out, given, density):
    """Density, restoring, viscosity and walls are those of the whole scene."""
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 0.0))
    liquid = rs.WeaklyCompressible(sound_speed=50.0, dynamic_viscosity=2.0, density=given)
    whole = scene_of(effects=(liquid, walls, left_out))
    rest, every = make_plan(without(whole, left_out.name)).effects, make_plan(whole).effects
    assert dict(rest) == {name: effect for name, effect in every.items() if name != left_out.name}
    assert rest["weakly_compressible"].density == density
