"""The pressure with which liquid at rest starts, of any parts that make it."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import refsim as rs
from refsim.sph.resting import RestingColumn


def cells(low, size):
    return np.array(low) + np.indices(size).reshape(3, -1).T


@pytest.mark.parametrize("spacing", [1e-6, 1.0])
def test_a_given_mass_stays_however_small_it_is(spacing):
    """1e-9 kg/m in a tank, whose particles without a mass get that of their pressure."""
    places = spacing * (cells((0, 0, 0), (4, 4, 1)) + 0.5) * [1, 1, 0]
    mass = np.full(16, 1.01 * 1000 * spacing**2)
    walls = rs.BoxWalls(lower=(0.0, 0.0, 0.0), upper=(4 * spacing, 8 * spacing, 0.0))
    scene = rs.Scene(
        dim=2, spacing=spacing, support_radius=3 * spacing, dtype="float64",
        fluid=(rs.Cloud(position=places, mass=mass),),
        effects=(rs.WeaklyCompressible(sound_speed=10.0), rs.Gravity(acceleration=(0.0, -0.1 / spacing, 0.0)), walls),
    )  # fmt: skip
    np.testing.assert_array_equal(rs.make_plan(scene).state.mass, mass)


G, RHO = 9.81, 1000.0


def integrated(load, sound, k):
    """(height, force on a side, pressure at half the height) by steps down the column, p from rho."""

    def density(p):
        return RHO * (1 + k * p / (RHO * sound**2)) ** (1 / k)

    def down(s, y):
        return [density(y[0]) * G, y[0]]

    def full(s, y):
        return y[0] - load * G

    full.terminal = True
    found = solve_ivp(down, (0, 10 * load / RHO), [0.0, 0.0], rtol=1e-12, atol=1e-12, events=full, dense_output=True)
    height = found.t_events[0][0]
    return height, found.y_events[0][0][1], found.sol(0.5 * height)[0]


@pytest.mark.parametrize("k", [1, 7])
@pytest.mark.parametrize(("load", "sound"), [(1000.0, 10 * math.sqrt(G)), (300.0, 4.0), (2e4, 1500.0)])
def test_the_column_is_the_solution_of_its_equation(load, sound, k):
    height, force, middle = integrated(load, sound, k)
    column = RestingColumn(load, G, RHO, sound, k)
    assert column.height() == pytest.approx(height, rel=1e-9)
    assert column.side_force() == pytest.approx(force, rel=1e-9)
    assert column.pressure(0.5 * height) == pytest.approx(middle, rel=1e-9)
    assert column.pressure(0.0) == pytest.approx(load * G, rel=1e-12)
    assert column.pressure(np.array([height, 2 * height])) == pytest.approx(0.0, abs=1e-9 * load * G)
