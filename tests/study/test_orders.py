"""Order, extrapolation and uncertainty against published values, another program, and problems with known answers."""

import math

import numpy as np
import pytest

from refsim.study.convergence import CAUTIOUS, SAFE, converge


def celik(h, q):
    """Order and extrapolated value by the fixed-point iteration of Celik et al. 2008, J. Fluids Eng. 130, 078001."""
    r21, r32 = h[1] / h[0], h[2] / h[1]
    e21, e32 = q[1] - q[0], q[2] - q[1]
    s = math.copysign(1.0, e32 / e21)
    p = 1.0
    for _ in range(2000):
        p = abs(math.log(abs(e32 / e21)) + math.log((r21**p - s) / (r32**p - s))) / math.log(r21)
    return p, (r21**p * q[0] - q[1]) / (r21**p - 1)


def test_the_published_example():
    """Celik et al. 2008, table 1, first column: dimensionless reattachment length."""
    found = converge([1.0, 1.5, 1.5 * 1.333], [6.063, 5.972, 5.863])
    assert found.asymptotic
    assert (found.order, found.value) == (pytest.approx(1.53, abs=0.01), pytest.approx(6.1685, abs=5e-4))
    assert found.uncertainty / 6.063 == pytest.approx(0.022, abs=5e-4)  # GCI, 2.2 %
    assert found.error(6.063) == pytest.approx(0.017, abs=5e-4)  # extrapolated relative error, 1.7 %


@pytest.mark.parametrize("order", [0.55, 1.0, 1.4, 2.0, 2.9])
@pytest.mark.parametrize("ratios", [(2.0, 2.0), (1.5, 1.5), (1.3, 1.7), (1.9, 1.2)])
@pytest.mark.parametrize("limit, slope", [(1.0, 3.0), (-40.0, 0.2), (1e-6, -1e-6)])
def test_power_laws_are_found(order, ratios, limit, slope):
    h = np.array([0.1, 0.1 * ratios[0], 0.1 * ratios[0] * ratios[1]])
    q = limit + slope * h**order
    found = converge(h[[1, 2, 0]], q[[1, 2, 0]])
    p, extrapolated = celik(h, q)
    assert found.asymptotic
    assert (found.order, found.order) == (pytest.approx(order, rel=1e-6), pytest.approx(p, rel=1e-6))
    assert (found.value, found.value) == (pytest.approx(extrapolated, rel=1e-6), pytest.approx(limit, rel=1e-6))
    inside = 0.9 <= order <= 2.2
    assert found.safety == (SAFE if inside else CAUTIOUS)
    if inside:
        assert found.uncertainty == pytest.approx(1.25 * abs(q[0] - limit), rel=1e-6)
        assert found.bound(q[2]) == pytest.approx(1.25 * abs(q[2] - limit) / abs(limit), rel=1e-6)
    assert found.uncertainty >= (1 - 1e-6) * 1.25 * abs(q[0] - limit)
