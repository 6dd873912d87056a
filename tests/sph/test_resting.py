"""A column at rest against an integration of its own, and the panels' and gauges' references against the column."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from refsim.sph.resting import RestingColumn

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
