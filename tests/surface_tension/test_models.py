"""Surface-tension models: forces, internal pressure, notes, what a scene pays for, bad input."""

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.effect import Discretisation
from refsim.study.panels.drops import pair_virials
from refsim.surface_tension.jiang_zhu_2023.modes import PAIR_MODES

COHESIVE = (rs.JiangZhu2023, rs.Akinci2013, rs.Dong2016, rs.BeckerTeschner2007, rs.TartakovskyMeakin2005)


def notes_with(plan, words):
    """Notes of a plan that contain the words."""
    return [note for note in plan.notes if words in note]


def beside_akinci(fluid, *others):
    """27 particles of this liquid under Akinci's tension."""
    effects = (fluid, rs.Akinci2013(surface_tension=1.0), *others)
    return rs.Scene(spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=(3, 3, 3)),), effects=effects)


def test_a_coefficient_on_an_advanced_density_is_noted():
    for density, restoring, noted in (("continuity", 0.3, 1), (None, 0.003, 0)):
        fluid = rs.WeaklyCompressible(sound_speed=100.0, dynamic_viscosity=10.0, density=density)
        plan = make_plan(beside_akinci(fluid))
        assert plan.effects["weakly_compressible"].restoring == restoring
        assert len(notes_with(plan, "calibrate(..., density = 'continuity')")) == noted


def test_the_angle_of_drops_on_walls_is_noted_below_a_bond_number_of_ten():
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(9.0, 9.0, 9.0))  # of 27 particles rho g R^2/sigma = 3461 g s^2/m
    for density, g, others, noted in (
        (None, 2.8e-3, (walls,), 1), (None, 3e-3, (walls,), 0), (None, 0.0, (), 0), ("summation", 0.0, (walls,), 0)
    ):  # fmt: skip
        fluid = rs.WeaklyCompressible(sound_speed=100.0, dynamic_viscosity=10.0, density=density)
        plan = make_plan(beside_akinci(fluid, rs.Gravity(acceleration=(0.0, 0.0, -g)), *others))
        assert len(notes_with(plan, "contact angle of 80 to 90 (in 2D 100 to 120) degrees")) == noted


def pool(dim, wide, pull, *tension, top=0.02, **given):
    """A pool of 5 mm at its start; walls to a height `top` [m]."""
    size = (wide, wide, 5) if dim == 3 else (wide, 5, 1)
    upper = (1e-3 * wide, top if dim == 2 else 1e-3 * wide, top)
    scene = rs.Scene(
        dim=dim, spacing=1e-3, support_radius=2.6e-3, dtype="float64", fluid=(rs.Box(cells=size),), **given,
        effects=(
            rs.WeaklyCompressible(sound_speed=10.0), rs.Gravity(acceleration=pull),
            rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=upper), *tension,
        ),
    )  # fmt: skip
    simulation = rs.Simulation(scene, "numpy")
    simulation.gauges.begin(simulation)
    return simulation


@pytest.mark.parametrize("cosine, lift", [(0.0, 0.0), (0.5, 0.65), (-0.5, -0.65)])
@pytest.mark.parametrize("dim", [2, 3])
def test_the_continuum_force_ends_at_walls_with_its_angle(dim, cosine, lift):
    """Sides pull a level surface by sigma cos(angle) along its rim, in a lattice 1.1 to 1.5 times; gauges tell it."""
    pull, faces = (0.0, -9.81, 0.0) if dim == 2 else (0.0, 0.0, -9.81), ("box_walls", "-" + "xyz"[dim - 1], "-x")
    gauges = tuple(rs.Gauge(name=face, kind="force", on=face) for face in faces)
    tension = rs.CsfWang2019(surface_tension=0.09, contact_angle=np.degrees(np.arccos(cosine)))
    with_it, without = (pool(dim, 10, pull, *effects, gauge=gauges) for effects in ((tension,), ()))
    told = [[simulation.gauge(face).values[0][dim - 1] for face in faces] for simulation in (with_it, without)]
    walls, floor, side = np.subtract(*told) / (0.09 * (2 if dim == 2 else 0.04))
    assert walls == pytest.approx(-lift, abs=0.1)
    assert floor == 0
    assert side * (2 if dim == 2 else 4) == pytest.approx(walls, abs=1e-9)
    gained = [simulation.field("mass") @ simulation.field("acceleration") for simulation in (with_it, without)]
    assert np.subtract(*gained)[dim - 1] == pytest.approx(told[1][0] - told[0][0], rel=1e-6, abs=1e-12)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", COHESIVE)
def test_walls_bear_the_weight_and_not_what_balances_cohesion(model, dim):
    """Of liquid that starts at rest: forces and pressures on walls are those without tension, to rounding."""
    pull = (0.0, -9.81, 0.0) if dim == 2 else (0.0, 0.0, -9.81)
    gauges = (
        rs.Gauge(name="walls", kind="force", on="box_walls"),
        rs.Gauge(name="floor", kind="pressure", at=(0, 0, 0)),
    )
    found = []
    for tension in ((), (model(surface_tension=0.09),)):
        simulation = pool(dim, 6, pull, *tension, gauge=gauges)
        found.append(np.concatenate([simulation.gauge(gauge.name).values[0] for gauge in gauges]))
    assert simulation.plan.shared["fluid"].internal_pressure > 10.0  # Pa, of 49 at the floor
    assert found[1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)


TENSIONS = (
    rs.JiangZhu2023(surface_tension=1.0), rs.JiangZhu2023(surface_tension=1.0, pair_mode="soft", area_ratio=0.2),
    rs.Akinci2013(surface_tension=1.0, area_acceleration=20.0), rs.Dong2016(surface_tension=1.0),
    rs.BeckerTeschner2007(surface_tension=1.0), rs.TartakovskyMeakin2005(surface_tension=1.0),
    rs.He2014(surface_tension=1.0, air_pressure=3.0),
)  # fmt: skip


@pytest.mark.parametrize("tension", TENSIONS, ids=lambda effect: effect.name + getattr(effect, "pair_mode", ""))
def test_sum_of_pairs_is_the_sum_of_the_forces(tension):
    """sum_pairs x_ij.F_ij = sum_i x_i.F_i, with the accelerations of the programs."""
    points = rs.Ball(radius=0.42).positions(Discretisation(3, "float64", 0.1, 0.26, 0))
    points += np.random.default_rng(2).uniform(-0.02, 0.02, points.shape)
    effects = (rs.WeaklyCompressible(rest_density=1.0, sound_speed=20.0, density="summation"), tension)
    scene = rs.Scene(spacing=0.1, support_radius=0.26, fluid=(rs.Cloud(position=points),), effects=effects)
    simulation = rs.Simulation(scene, "numpy")
    simulation.evaluate()
    x, a, m = (simulation.field(name).astype(float) for name in ("position", "acceleration", "mass"))
    _, _, virial = pair_virials(simulation)
    assert virial.sum() == pytest.approx((m[:, None] * x * a).sum(), abs=2e-6 * np.abs(virial).sum())
    assert abs(virial.sum()) > 1e-3 * np.abs(virial).sum()


RATIO = 2.7  # support radius in spacings


def drop(**parameters):
    """27 particles under this tension."""
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=40.0, dynamic_viscosity=0.2, density="summation")
    effects = (liquid, rs.JiangZhu2023(**parameters))
    return rs.Scene(spacing=0.2, support_radius=0.2 * RATIO, fluid=(rs.Box(cells=(3, 3, 3)),), effects=effects)


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
