"""Yardsticks against limits that are known, answers by hand and other programs; studies that find them."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from refsim.sph.resting import RestingColumn
from tests.running import rows
from validation.experiments.liquid import runs as tanks
from validation.measure import studies
from validation.measure.studies import SOLVED, sloshed
from validation.metrics import solutions as scene
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface
from validation.running import Context


def test_compressed_heights_are_in_balance():
    rest, gravity, sound = np.linspace(0.0, 1.0, 4001), 9.81, 15.0
    below = RestingColumn(1.0 - rest, gravity, 1.0, sound).height()
    top, height = below[0], below[0] - below
    assert (height[0], height[-1]) == (pytest.approx(0.0, abs=1e-12), pytest.approx(top, rel=1e-12))
    middle = 0.5 * (height[1:] + height[:-1])
    pressure = sound**2 * 1000.0 * (np.diff(rest) / np.diff(height) - 1)
    wanted = 1000.0 * sound**2 * np.expm1(gravity * (top - middle) / sound**2)
    np.testing.assert_allclose(pressure, wanted, atol=1e-2)


def test_a_small_ellipse_swings_with_root_two_and_lambs_damping():
    time, friction = np.linspace(0.0, 10.0, 4001), 0.1  # f = 2 nu; Lamb 1932, art. 355, in 2D: 4 nu/R^2 = 2 f/R^2
    a, b = scene.ellipse(time, 1.0, 1.0, 1e-3, friction)
    np.testing.assert_allclose(a * b, 1.0, rtol=1e-8)
    rate = np.sqrt(2.0 - (2 * friction) ** 2)
    np.testing.assert_allclose(a - 1, 1e-3 / rate * np.exp(-2 * friction * time) * np.sin(rate * time), atol=3e-6)


def test_a_free_ellipse_keeps_its_energy():
    time = np.linspace(0.0, 8.0, 401)
    a, b = scene.ellipse(time, 1.0, 0.7, 0.5, 0.0)
    sigma = np.gradient(np.log(a), time, edge_order=2)
    energy = (sigma**2 + 0.7**2) * (a**2 + b**2)
    np.testing.assert_allclose(energy, energy[0], rtol=2e-3)


def test_spin_down_begins_with_4_and_ends_with_3_39():
    left = scene.spin_down(np.array([0.0, 1e-3, 1.0, 2.0]), 1.0)
    assert (left[0], left[1]) == (pytest.approx(1.0), pytest.approx(1 - 4e-3, rel=1e-4))
    assert np.log(left[2] / left[3]) == pytest.approx(1.8411837813**2, rel=1e-6)


def test_waves_are_fitted():
    time = np.linspace(0, 4, 200)
    decay, rate = scene.fitted(time, 0.3 * np.exp(-0.4 * time) * np.cos(5.0 * time), 0.3, 5.3)
    assert (decay, rate) == pytest.approx((0.4, 5.0))
    assert scene.peak(time, np.cos(time - 1.234)) == pytest.approx(1.234, abs=1e-4)


@pytest.mark.parametrize("form", ["central", "laplacian"])
def test_a_standing_wave_of_little_viscosity_is_potential_flow(form):
    omega, gamma = scene.wave(np.pi, 0.5, 9.81, 1e-5, form)
    assert omega == pytest.approx(np.sqrt(9.81 * np.pi * np.tanh(np.pi / 2)))
    time = np.linspace(0, 4 * 2 * np.pi / omega, 321)
    part, _ = scene.standing_wave(time, np.pi, 0.5, 9.81, 1e-5, 200.0, form, 40)
    decay, rate = scene.fitted(time, part, gamma, omega)
    assert (rate, decay) == (pytest.approx(omega, rel=1e-4), pytest.approx(gamma, rel=0.01))


def test_a_standing_wave_on_deep_water_is_prosperettis():
    time = np.linspace(0, 30, 301)
    _, level = scene.standing_wave(time, 1.0, 8.0, 1.0, 0.02, 300.0, "central", 50)
    np.testing.assert_allclose(level, scene.prosperetti(time, 1.0, 0.02, velocity=True), atol=1e-5)


@pytest.mark.parametrize("damping", [1e-3, 0.03, 0.2])
def test_prosperettis_wave_fulfils_its_equation(damping):
    """Its Laplace transform is that of the linear equations on deep water (Prosperetti 1976, eq. 20): from a(0) = 1,
    (1 - omega_0^2/D)/s, and omega_0/D from a'(0) = omega_0; D = (s + 2 n)^2 + omega_0^2 - 4 n^2 sqrt(1 + s/n)."""
    time = np.linspace(0.0, 200.0, 400001)
    n, square = damping, 1.7**2
    s = np.array([[0.2], [0.5], [1.5]])
    shape = (s + 2 * n) ** 2 + square - 4 * n**2 * np.sqrt(1 + s / n)
    for velocity, wanted in ((False, (1 - square / shape) / s), (True, np.sqrt(square) / shape)):
        height = scene.prosperetti(time, square, n, velocity)
        assert np.trapezoid(height * np.exp(-s * time), time) == pytest.approx(wanted[:, 0], rel=1e-5)


def test_a_wall_carries_what_it_lifts():
    """The profile x(z) of a meniscus (Landau & Lifshitz, section 61), integrated: z'' = z (1 + z'^2)^1.5."""
    from scipy.integrate import solve_ivp

    height, area = scene.meniscus(1.0, np.radians(70.0))
    found = solve_ivp(
        lambda x, y: [y[1], y[0] * (1 + y[1] ** 2) ** 1.5, y[0]], (0.0, 8.0),
        [height, -1 / np.tan(np.radians(70.0)), 0.0], rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    assert found.y[2, -1] == pytest.approx(area, rel=1e-3)
    assert np.allclose(scene.meniscus(1.0, np.radians(110.0)), (-height, -area))


def test_plates_begin_at_rest_and_end_in_the_steady_flow():
    """Both series solve u_t = nu u_yy + F between the plates, with the plates' velocities at the ends."""
    height = np.linspace(0.0, 2.0, 81)
    for flow, steady, push, wall in (
        (lambda time: scene.couette(height, time, 2.0, 3.0, 0.5), 1.5 * height, 0.0, 3.0),
        (lambda time: scene.poiseuille(height, time, 2.0, 0.7, 0.5), 0.7 * height * (2 - height), 0.7, 0.0),
    ):
        assert np.abs(flow(1e-3)[height < 1.8]).max() < 1e-3
        np.testing.assert_allclose(flow(100.0), steady, atol=1e-12)
        assert flow(0.3)[[0, -1]] == pytest.approx([0.0, wall], abs=1e-9)
        change = (flow(0.3001) - flow(0.2999)) / 2e-4
        # the second difference is off by dy^2 / 12 of the fourth derivative of at most 37: 9.5e-4 with nu = 0.5
        bent = np.diff(flow(0.3), 2) / (height[1] - height[0]) ** 2
        np.testing.assert_allclose(change[1:-1], 0.5 * bent + push, atol=2e-3)


def grid(*sites):
    """Lattice of unit spacing, (n, dim)."""
    return np.stack(np.meshgrid(*[np.arange(float(n)) for n in sites], indexing="ij"), axis=-1).reshape(-1, len(sites))


def rim(*sites):
    """Which sites of ``grid`` lie on its outside."""
    point = grid(*sites)
    return ((point == 0) | (point == np.array(sites) - 1)).any(axis=1)


COVER = {2: arc_cover_surface, 3: cap_cover_surface}


@pytest.mark.parametrize("dim", [2, 3])
def test_coincident_particles_are_one(dim):
    twin = np.zeros((2, dim))
    assert COVER[dim](twin, 1.0).all()
    assert COVER[dim](twin + [[0.0] * dim, [1e-12] * dim], 1.0).all()
    row = np.zeros((3, dim))
    row[:, 0] = -1e-12, 0.0, 1e-12
    assert COVER[dim](row, 1.0).all()
    block = grid(*(5,) * dim)
    double = np.vstack((block, block, block[:3]))
    expected = np.tile(rim(*(5,) * dim), 2)
    assert np.array_equal(COVER[dim](double, 1.2)[: 2 * len(block)], expected)
    one_sided = np.zeros((3, dim))
    one_sided[1:, 0] = 1.0  # equal caps: neither may hide the other's boundary
    assert COVER[dim](one_sided, 1.0).all()
    one_sided[2, 0] += 1e-8
    assert COVER[dim](one_sided, 1.0)[0]


@pytest.mark.parametrize("dim", [2, 3])
def test_walls_cover_but_are_not_judged(dim):
    block = grid(*(6,) * dim)
    outside = grid(*(8,) * dim)[rim(*(8,) * dim)] - 1
    assert not COVER[dim](block, 1.2, outside).any()
    tank = outside[outside[:, -1] < 6]  # open at the top
    assert np.array_equal(COVER[dim](block, 1.2, tank), block[:, -1] == 5)
    assert COVER[dim](block[:1], 1.2, tank[:1]).tolist() == [True]


def test_neighbour_search_is_completed_in_dense_clumps():
    """More neighbours than one search returns: what decides must not be the number looked at."""
    rng = np.random.default_rng(8)
    for dim in (2, 3):
        clump = rng.normal(0, 1e-3, (150, dim))
        answer = COVER[dim](clump, 1.0)
        # R is a thousand times the clump's size, so the probe is all but flat: the convex hull
        assert np.array_equal(np.flatnonzero(answer), np.sort(ConvexHull(clump).vertices))


def conducted(start, held, seconds, cell, conductivity, density, heat_of, temperature_of):
    """Temperatures [degrees C] of cells in a row after `seconds`, explicitly; the first `held` stay as they were."""
    heat = heat_of(start)
    capacity = np.diff(heat_of(np.array([-2.0, -1.0])))[0]
    count = int(np.ceil(seconds / (0.4 * density * capacity * cell**2 / conductivity)))
    for _ in range(count):
        flux = conductivity * -np.diff(temperature_of(heat)) / cell  # W/m^2
        change = np.concatenate([[0.0], flux]) - np.concatenate([flux, [0.0]])
        change[:held] = 0.0
        heat = heat + seconds / count * change / (density * cell)
    return heat


def test_the_slab_by_finite_volumes():
    cells = 200
    start = np.where(np.arange(cells) < cells // 2, 100.0, 0.0)
    heat = conducted(start, 0, 20.0, 0.1 / cells, 400.0, 8960.0, lambda t: 385.0 * t, lambda h: h / 385.0)
    at = 385.0 * SOLVED["slab"].answer()
    assert heat[cells // 4 - 1 : cells // 4 + 1].mean() == pytest.approx(at, rel=1e-4)


@pytest.mark.parametrize("given", rows(__file__, "melts"), ids=lambda given: given[0])
def test_melting_by_finite_volumes(given):
    name, wall, cold, until, length, conductivity, capacity, density, latent = given

    def heat_of(t):
        return np.where(t > 0, latent + capacity * t, capacity * t)

    def temperature_of(h):
        return np.where(h > latent, (h - latent) / capacity, np.minimum(h, 0.0) / capacity)

    means = []
    for cells in (125, 250):  # the wall's temperature stands half a cell from the face: an error of first order
        held = cells // 5
        start = np.where(np.arange(cells) < held, wall, -cold)
        heat = conducted(start, held, until, length / cells, conductivity, density, heat_of, temperature_of)
        means.append(heat.mean())
    assert 2 * means[1] - means[0] == pytest.approx(SOLVED[name].answer(), rel=2e-4)


def test_the_sloshing_water_is_that_of_its_level():
    """In shallow water, by the wave equation of the level in cells of equal width."""
    length, depth, push, rate, until, cells, steps = 1.0, 0.02, 0.2, 4.0, 2.0, 200, 4000
    level, speed, moved = np.zeros(cells), np.zeros(cells + 1), 0.0
    width, dt = length / cells, until / steps
    for k in range(steps):  # velocities stand on faces, half a step behind the level
        slope = np.diff(level) / width
        speed[1:-1] -= dt * (9.81 * slope + push * np.sin(rate * k * dt))
        level -= dt * depth * np.diff(speed) / width
        moved += dt * speed[1:-1].sum() / cells
    assert sloshed(until, length, depth, push, rate) == pytest.approx(moved, rel=0.01)


def test_the_rod_is_that_of_its_modes():
    """Kinetic energy of a rod on a foot, summed over its modes."""
    n = np.arange(1, 4001, 2)
    height, pull, sound, time = 1.0, 9.81, 10.0, 0.05
    speed = 8 * pull * height / (np.pi**2 * n**2 * sound) * np.sin(n * np.pi * sound * time / (2 * height))
    energy = 0.5 * 1000.0 * 0.4 * height / 2 * (speed**2).sum()
    assert SOLVED["column"].answer() == pytest.approx(energy, rel=1e-6)


def test_a_study_finds_the_exact_answer_and_foresees_a_finer_run():
    """At coarser levels than the page's, so that NumPy is fast enough."""
    slab = SOLVED["slab"]
    found = slab.study("slab", levels=3, finer=1, backend="numpy", knobs=("spacing",))
    limit, answer = found.convergence, slab.answer()
    assert limit.asymptotic
    assert 1.5 < limit.order < 2.2
    assert abs(limit.value - answer) < limit.uncertainty
    finer = studies.further(found, slab, None, "numpy")
    finest = found.of("spacing")[-1][1]
    assert finer.run.particles > finest.particles
    assert abs(finer.run.value - finer.value) < 0.2 * abs(finer.run.value - finest.value)
    assert abs(finer.run.value - answer) < abs(finest.value - answer)


def test_the_pool_over_the_torus_is_that_of_its_volume():
    """Of an incompressible liquid by the mesh's volume; compressed, it sinks by g H^2/(3 c^2) or so."""
    trimesh = pytest.importorskip("trimesh")
    file = studies.SCENES / "torus.obj"
    ring = trimesh.load(file)
    depth = (0.6**3 + ring.volume) / 0.8**2
    centre = (0.5 * 0.8**2 * depth**2 - 0.2 * ring.volume) / 0.6**3
    assert studies.poured(0.6**3, 0.8, file, 1e6) == pytest.approx(centre, rel=1e-5)
    assert SOLVED["torus"].answer() == pytest.approx(centre - 9.81 * depth**2 / (3 * 40.0**2), rel=5e-4)


def test_the_walls_of_a_tank_carry_its_weight():
    simulation = Context().simulation(tanks._water(2, (8, 8), 3.0, tanks._liquid("rests", tanks.SOUND, 0.01)), "numpy")
    for _ in range(40):
        simulation.step()
    assert tanks.pushed(simulation)[1] == pytest.approx(simulation.field("mass").sum() * tanks.GRAVITY, rel=0.1)
