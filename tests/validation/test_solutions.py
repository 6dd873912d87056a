"""The experiment `solutions`: its solutions against limits that are known, and its runs at small size."""

import numpy as np
import pytest

from refsim.study.panels.scenes import compressed
from validation.metrics import solutions as scene


def test_compressed_heights_are_in_balance():
    rest, gravity, sound = np.linspace(0.0, 1.0, 4001), 9.81, 15.0
    height, top = compressed(rest, 1.0, gravity, sound)
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
