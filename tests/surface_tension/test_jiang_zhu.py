"""Tension after Jiang & Zhu 2023: its force's shape and numbers, conservation, pairing, a cube that rounds off."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from refsim import (
    Box,
    Cloud,
    InputError,
    JiangZhu2023,
    Scene,
    Simulation,
    SurfaceDetection,
    WeaklyCompressible,
    make_plan,
)
from refsim.core.effect import Discretisation
from refsim.smoothing import smoothing
from refsim.surface_tension.jiang_zhu_2023 import (
    AreaTerm,
    PairSelection,
    SoftThresholds,
    formulas,
    kirkwood_buff_pressure,
    kirkwood_buff_sigma,
    reference,
)
from refsim.surface_tension.jiang_zhu_2023.modes import PAIR_MODES

H = 2.7  # support radius in spacings


def prepared(dim=3, dtype="float64", support_radius=1.0, spacing=None, rest_density=1.0, **parameters):
    """Parameter groups of the effect, with rho0 = 1 and h = 1 unless told otherwise."""
    grid = Discretisation(dim, dtype, spacing or support_radius / H, support_radius, 100)
    effect = JiangZhu2023(**({"gamma": 1.0} | parameters))
    others = {
        "weakly_compressible": WeaklyCompressible(rest_density=rest_density, sound_speed=100.0),
        effect.name: effect,
    }
    effect.check(grid, others)
    return effect.prepare(grid, others)


def shape(q, **options):
    cohesion = prepared(**options)["cohesion"]
    return np.array([formulas.force_shape(np.float64(x), cohesion) for x in np.atleast_1d(q)])


def drop(n=5, dtype="float32", dim=3, fluid=None, wobble=0.0, **parameters):
    spacing = 1.0 / n
    cells = (n, n, n if dim == 3 else 1)
    part = Box(lower=(-0.5, -0.5, -0.5), cells=cells)
    if wobble:
        grid = Discretisation(dim, dtype, spacing, H * spacing, 0)
        points = part.positions(grid)
        points[:, :dim] += np.random.default_rng(7).uniform(-wobble, wobble, (len(points), dim)) * spacing
        part = Cloud(position=points)
    effects = [fluid or WeaklyCompressible(rest_density=1.0, sound_speed=40.0, dynamic_viscosity=0.2)]
    if parameters:
        effects.append(JiangZhu2023(**parameters))
    return Scene(
        spacing=spacing, support_radius=H * spacing, dim=dim, dtype=dtype, fluid=(part,), effects=tuple(effects)
    )


# The force function J(17)


@pytest.mark.parametrize("dim", [2, 3])
def test_force_function_has_the_published_shape(dim):
    q = np.linspace(0, 1, 20001)
    c = shape(q, dim=dim)
    assert c[0] == pytest.approx(0.6 / 0.8**3 - 0.9, rel=1e-12)
    zero = q[np.flatnonzero(c < 0)[0]]
    assert zero == pytest.approx(0.3609, abs=1e-4)
    lowest = np.argmin(c)
    assert q[lowest] == pytest.approx(0.589, abs=1e-3)
    assert c[0] / -c[lowest] == pytest.approx(1.97, abs=5e-3)
    assert c[-1] == 0.0


def test_printed_coefficient_in_2d_has_hardly_any_core():
    q = np.linspace(0, 1, 20001)
    c = shape(q, dim=2, literal=("E7",))
    assert q[np.flatnonzero(c < 0)[0]] == pytest.approx(0.153, abs=1e-3)
    assert c[0] / -c.min() == pytest.approx(0.22, abs=5e-3)


@pytest.mark.parametrize("support_radius", [1e-6, 1e3])
@pytest.mark.parametrize("dim", [2, 3])
def test_force_scales_with_the_support_radius_in_float32(support_radius, dim):
    """J(17) and J(21) of one neighbour at q = 0.2, with gamma and the Kirkwood-Buff moments of poly6 as fractions.

    int q^4 (1 - q^2)^3 = 16/1155 in space, int q^3 (1 - q^2)^3 = 1/40 in the plane; that of W(r, 0.8 h) is 0.8^2 times.
    """
    h, q, rho0, sigma = support_radius, 0.2, 1e3, 0.07
    mass = rho0 * (h / H) ** dim
    factor, moment, norm, alpha = {
        2: (1 / 3, 1 / 40, 4 / math.pi, 0.75),
        3: (math.pi / 8, 16 / 1155, 315 / (64 * math.pi), 0.6),
    }[dim]
    gamma = sigma / (factor * rho0**2 * h**2 * norm * moment * (0.9 - alpha * 0.64))
    shape = alpha / 0.8**dim * (1 - (q / 0.8) ** 2) ** 3 - 0.9 * (1 - q**2) ** 3
    groups = prepared(dim, "float32", h, rest_density=rho0, gamma=None, surface_tension=sigma)
    value = formulas.cohesion_pair(np.float32(mass), np.float32(q), groups["cohesion"])
    assert value.dtype == np.float32
    assert value == pytest.approx(mass * gamma * norm / h**dim * shape, rel=1e-4)
    volume = formulas.area_pair(np.float32(mass), np.float32(rho0), groups["area"])
    strength = formulas.area_strength(np.float32(rho0), groups["area"])
    gradient = np.float32(1 / h)
    expected = 0.01 * gamma * h ** (1 - dim) * mass / h
    assert strength * (volume * gradient) == pytest.approx(expected, rel=1e-4)


def test_printed_sign_attracts_where_the_adopted_one_repels():
    near = np.array([[0.0, 0, 0], [0.1, 0, 0]])
    for literal, sign in (((), -1), (("E4",), 1)):
        groups = prepared(literal=literal, area_term="none", pair_mode="all")
        value = oracle_tension(near, np.ones(2), groups)[0]
        assert np.sign(value[0, 0]) == sign


# Nominal tension and cohesive pressure


@pytest.mark.parametrize(
    "dim, alpha, sigma, pressure",
    [(3, 0.6, 0.004398, 0.03445), (2, 0.75, 0.004456, 0.03048), (2, 0.6, 0.005475, 0.04267)],
)
def test_kirkwood_buff_numbers(dim, alpha, sigma, pressure):
    assert kirkwood_buff_sigma(1.0, 1.0, 1.0, dim, alpha) == pytest.approx(sigma, rel=2e-4)
    assert kirkwood_buff_pressure(1.0, 1.0, 1.0, dim, alpha) == pytest.approx(pressure, rel=2e-4)
    assert kirkwood_buff_sigma(3.0, 10.0, 0.1, dim, alpha) == pytest.approx(3 * sigma, rel=2e-4)
    assert kirkwood_buff_pressure(3.0, 10.0, 0.1, dim, alpha) == pytest.approx(30 * pressure, rel=2e-4)


# Pair modes


def oracle_tension(position, mass, groups, weight=None, surface=None, normal=None, density=None):
    dim = 3
    kernel = smoothing("wendland_c2", 1.0, dim)
    density = np.ones(len(mass)) if density is None else density
    return reference.tension(
        position, mass, density, weight, surface, normal, kernel, groups["pairs"], groups["cohesion"], groups["area"]
    )["acceleration"]


@pytest.mark.parametrize("mode", PAIR_MODES)
def test_pair_weight_table(mode):
    expected = {
        "soft": lambda wi, wj, si, sj: (wi + wj) / 2,
        "all": lambda wi, wj, si, sj: 1,
        "one_sided": lambda wi, wj, si, sj: si,
        "either": lambda wi, wj, si, sj: max(si, sj),
        "both": lambda wi, wj, si, sj: min(si, sj),
    }[mode]
    for wi, wj, si, sj in itertools.product((0.0, 0.25, 1.0), (0.0, 0.25, 1.0), (0, 1), (0, 1)):
        base, slope = formulas.pair_weight(PAIR_MODES[mode], np.float32(wi), np.uint8(si))
        assert base + slope * (wj if mode == "soft" else sj) == expected(wi, wj, si, sj)
        assert base.dtype == slope.dtype == np.float32
        assert reference.pair_shares(PAIR_MODES[mode], wi, wj, si, sj) == expected(wi, wj, si, sj)


def cloud(count=60, dim=3, seed=3):
    """Random particles of mixed masses in a box of two support radii; flags and weights at random."""
    rng = np.random.default_rng(seed)
    position = rng.uniform(0, 2, (count, 3))
    if dim == 2:
        position[:, 2] = 0
    return SimpleNamespace(
        position=position,
        mass=rng.uniform(0.01, 0.1, count),
        density=rng.uniform(0.5, 1.5, count),
        surface=rng.integers(0, 2, count).astype(np.uint8),
        surface_weight=np.maximum(rng.uniform(-0.5, 1, count), 0),
        surface_normal=rng.normal(size=(count, 3)),
        corrected_normal=rng.normal(size=(count, 3)),
    )


@pytest.mark.parametrize("mode", PAIR_MODES)
@pytest.mark.parametrize("area_term", ["none", "corrected"])
def test_momentum_of_the_pair_modes(mode, area_term):
    c = cloud()
    groups = prepared(pair_mode=mode, area_term=area_term)
    value, scale = oracle_tension(
        c.position, c.mass, groups, c.surface_weight, c.surface, c.corrected_normal, c.density
    )
    force = c.mass[:, None] * value
    round_off = 1e-14 * (c.mass[:, None] * scale).sum()
    linear = np.abs(force.sum(0)).max()
    angular = np.abs(np.cross(c.position, force).sum(0)).max()
    if mode == "one_sided":
        assert linear > 1e6 * round_off
        return
    assert linear < round_off
    if area_term == "none":
        assert angular < 10 * round_off
    else:
        assert angular > 1e6 * round_off  # Jiang & Zhu E12


# Density correction J(14), J(15)


def test_density_correction_keeps_a_constant_density():
    c = cloud()
    density = np.full(len(c.mass), 3.7)
    kernel = smoothing("wendland_c2", 1.0, 3)
    fluid = SimpleNamespace(rest_density=1.0)
    marked = np.ones(len(c.mass))
    rho, _ = reference.corrected_density(c.position, c.mass, density, marked, None, kernel, fluid)["corrected_density"]
    np.testing.assert_allclose(rho, density, rtol=1e-12)


def test_density_correction_lifts_the_surface_before_the_equation_of_state():
    fluid = WeaklyCompressible(rest_density=1.0, sound_speed=40.0, clamp_pressure=False)
    raw = Simulation(drop(11, fluid=fluid), "cpu")
    corrected = Simulation(drop(11, fluid=fluid, gamma=0.0, density_correction=True), "cpu")
    for simulation in (raw, corrected):
        simulation.evaluate()
    assert corrected.plan.launches()[:4] == (
        "sph.density",
        "surface_detection.near_surface",
        "jiang_zhu_2023.corrected_density",
        "jiang_zhu_2023.replace_density",
    )
    before, after = raw.field("density"), corrected.field("density")
    near = corrected.field("near_surface") != 0
    assert 0 < near.sum() < len(near)
    assert np.array_equal(before[~near], after[~near])
    distance = np.abs(corrected.field("position"))
    face_middles = (distance.max(1) > 4.5 / 11) & (np.sort(distance, axis=1)[:, 1] < 0.5 / 11)
    assert face_middles.sum() == 6
    assert np.all(after[face_middles] > 1.04 * before[face_middles])
    assert after.min() > 1.2 * before.min()
    assert after.max() <= before.max()  # a mean of neighbouring densities
    np.testing.assert_allclose(corrected.field("pressure"), 1600 * (after - 1), rtol=1e-5, atol=1e-3)


# In a scene


@pytest.mark.parametrize("mode", PAIR_MODES)
def test_a_scene_pays_only_for_what_its_pair_mode_uses(mode):
    plan = make_plan(drop(surface_tension=1.0, pair_mode=mode, area_ratio=0.0, density_correction=False))
    launches = set(plan.launches()) - {"sph.density", "sph.state", "sph.momentum"}
    detection = {"surface_detection.candidates", "surface_normal.color_gradient", "surface_detection.fan_scan"}
    assert launches == {"jiang_zhu_2023.cohesion"} | {
        "soft": {"surface_normal.color_gradient", "jiang_zhu_2023.soft_weight"},
        "all": set(),
    }.get(mode, detection)
    assert "corrected_normal" not in plan.fields
    assert ("surface" in plan.fields) == (mode not in ("soft", "all"))


def test_detection_shares_its_passes_with_tension():
    scene = drop(surface_tension=1.0, pair_mode="either", density_correction=True, area_term="color")
    alone = make_plan(scene).launches()
    assert len(alone) == len(set(alone))
    beside = Scene(
        **(
            {f: getattr(scene, f) for f in scene.__struct_fields__}
            | {"effects": (*scene.effects, SurfaceDetection(threshold=0.95))}
        )
    )
    plan = make_plan(beside)
    assert sorted(plan.launches()) == sorted(alone)
    limit = plan.parameters["jiang_zhu_2023"]["near_surface_limit"].number_density
    fluid = plan.effects["weakly_compressible"]
    assert limit == pytest.approx(0.95 * fluid.rest_number_density(plan.grid))


def radius_variation(position):
    """std/mean over 200 Fibonacci directions of the greatest distance from the centre within 20 degrees."""
    k = np.arange(200) + 0.5
    polar, around = np.arccos(1 - k / 100), math.pi * (1 + math.sqrt(5)) * k
    directions = np.stack([np.cos(around) * np.sin(polar), np.sin(around) * np.sin(polar), np.cos(polar)], 1)
    offset = position - position.mean(0)
    distance = np.linalg.norm(offset, axis=1)
    inside = offset @ directions.T > math.cos(math.radians(20)) * distance[:, None]
    outermost = np.where(inside, distance[:, None], 0).max(0)
    return outermost.std() / outermost.mean()


def test_a_cube_rounds_off():
    simulation = Simulation(drop(9, surface_tension=1.0), "cpu")
    cube = radius_variation(simulation.field("position"))
    while simulation.time < 0.55:
        simulation.step()
    position, velocity = simulation.field("position"), simulation.field("velocity")
    assert radius_variation(position) < 0.25 * cube
    assert np.abs(velocity.mean(0)).max() < 1e-5
    assert np.sqrt((velocity**2).sum(1).mean()) < 0.2


# Bad input


@pytest.mark.parametrize(
    "parameters, words",
    [
        ({}, "neither of surface_tension and gamma"),
        ({"surface_tension": 1.0, "gamma": 1.0}, "both of surface_tension and gamma"),
        ({"surface_tension": -1.0}, "surface_tension = -1.0"),
        ({"gamma": math.nan}, "gamma = nan"),
        ({"gamma": 1.0, "area_ratio": math.inf}, "area_ratio = inf"),
        ({"gamma": 1.0, "soft_lower": 1.0}, "soft_lower < soft_upper"),
        ({"gamma": 1.0, "pair_mode": "some"}, "pair_mode = 'some' is not possible; choose from"),
        ({"gamma": 1.0, "area_term": "some"}, "area_term = 'some' is not possible; choose from corrected, color, none"),
        ({"gamma": 1.0, "literal": ("E3",)}, "literal has E3"),
        ({"surface_tension": 500.0, "balance_pressure": False}, "would collapse the liquid"),
        ({"gamma": 1.0, "density_correction": True, "threshold": 2.0}, "threshold = 2.0"),
    ],
)
def test_bad_parameters_get_one_sentence(parameters, words):
    liquid = WeaklyCompressible(rest_density=1.0, sound_speed=40.0)
    with pytest.raises(InputError, match=words):
        make_plan(
            Scene(
                spacing=0.2,
                support_radius=0.54,
                fluid=(Box(cells=(3, 3, 3)),),
                effects=(liquid, JiangZhu2023(**parameters)),
            )
        )


def test_groups_hold_the_runs_dtype():
    for group in (AreaTerm, PairSelection, SoftThresholds):
        found = next(g for g in prepared(dtype="float32").values() if isinstance(g, group))
        assert all(type(x) in (np.float32, np.int32) for x in found)
