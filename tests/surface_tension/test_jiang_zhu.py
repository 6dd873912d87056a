"""Tension after Jiang & Zhu 2023: its force's shape and numbers, conservation, pairing, a cube that rounds off."""

import pytest

import refsim as rs
from refsim import make_plan
from refsim.surface_tension.jiang_zhu_2023.modes import PAIR_MODES
from tests.running import rows

H = 2.7  # support radius in spacings


def drop(**parameters):
    """27 particles under this tension."""
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=40.0, dynamic_viscosity=0.2, density="summation")
    effects = (liquid, rs.JiangZhu2023(**parameters))
    return rs.Scene(spacing=0.2, support_radius=0.2 * H, fluid=(rs.Box(cells=(3, 3, 3)),), effects=effects)


# Density correction J(14), J(15)
# In a scene
@pytest.mark.parametrize("mode", PAIR_MODES)
def test_a_scene_pays_only_for_what_its_pair_mode_uses(mode):
    plan = make_plan(drop(surface_tension=1.0, pair_mode=mode, area_ratio=0.0, density_correction=False))
    launches = set(plan.launches()) - {"sph.density", "sph.state", "sph.momentum"}
    detection = {"surface_detection.candidates", "surface_normal.color_gradient", "surface_detection.fan_scan"}
    assert launches == {"jiang_zhu_2023.cohesion"} | {
        "soft": {"surface_normal.color_gradient", "jiang_zhu_2023.soft_weight"}, "all": set(),
    }.get(mode, detection)  # fmt: skip
    assert "corrected_normal" not in plan.fields
    assert ("surface" in plan.fields) == (mode not in ("soft", "all"))


@pytest.mark.parametrize("kernels, ratio", [("wendland", 0.006), ("cubic_spline", 0.006), ("mueller", 0.01)])
@pytest.mark.parametrize("direction, share", [("normals", 1.0), ("axial", 2 / 3)])
def test_an_area_term_that_is_left_open_lets_drops_rest(kernels, ratio, direction, share):
    """In a plan without a note on it; with Mueller kernels drops rest up to 0.012."""
    tension = rs.JiangZhu2023(surface_tension=0.07, area_direction=direction)
    liquid = rs.WeaklyCompressible(sound_speed=30.0, dynamic_viscosity=5.0, kernels=kernels)
    fluid = rs.Box(cells=(3, 3, 3))
    plan = make_plan(rs.Scene(spacing=0.01, support_radius=0.026, fluid=(fluid,), effects=(liquid, tension)))
    most = 0.008 if (kernels, direction) == ("mueller", "axial") else ratio * share
    assert tension.ratio_of_area(plan.effects) == pytest.approx(most)
    assert not any("area_ratio" in note for note in plan.notes)


def test_detection_shares_its_passes_with_tension():
    scene = drop(surface_tension=1.0, pair_mode="either", density_correction=True, area_term="color")
    alone = make_plan(scene).launches()
    assert len(alone) == len(set(alone))
    beside = scene.with_(effects=(*scene.effects, rs.SurfaceDetection(threshold=0.95)))
    plan = make_plan(beside)
    assert sorted(plan.launches()) == sorted(alone)
    limit = plan.parameters["jiang_zhu_2023"]["near_surface_limit"].number_density
    fluid = plan.effects["weakly_compressible"]
    assert limit == pytest.approx(0.95 * fluid.rest_number_density(plan.grid))


# Bad input
@pytest.mark.parametrize("parameters, words", rows(__file__, "bad_jiang_zhu"))
def test_bad_parameters_get_one_sentence(parameters, words):
    with pytest.raises(rs.InputError, match=words):
        make_plan(drop(**parameters))
