"""Which model for which accuracy: errors and advice from drops that are made up."""

import math

import pytest

from validation.cases import tension_cost


def row(radius, laplace, rayleigh, seconds, model="akinci", stopped=""):
    base = {"dim": 3, "support": 2.6, "stiffness": 0.01, "kernels": "mueller", "model": model, "radius": radius}
    return {
        **base, "stopped": stopped, "laplace": laplace, "rayleigh": rayleigh, "misfit": 0.1, "roughness": 0.01,
        "seconds": seconds, "particles": 100,
    }  # fmt: skip


@pytest.fixture
def promise(monkeypatch):
    monkeypatch.setattr(tension_cost, "promised", lambda model, rows: 4.0)


def test_errors_are_those_off_the_promised_tension(promise):
    (point,) = tension_cost.points([row(10.0, 4.4, 4.0 * 1.1**2, 9.0), row(10.0, 3.6, 4.0 * 0.9**2, 7.0)])
    assert (point["sigma"], point["frequency"]) == (pytest.approx(0.1), pytest.approx(0.1))
    assert (point["seconds"], point["seeds"]) == (7.0, 2)
    (gone,) = tension_cost.points([row(10.0, 4.0, 4.0, 9.0), row(10.0, math.nan, math.nan, 1.0, stopped="dispersed")])
    assert gone["stopped"] == "dispersed"


def test_advice_is_the_cheapest_that_stays_within_the_bar_at_every_larger_size(promise):
    rows = [row(7.0, 4.0, 4.0, 1.0), row(10.0, 4.3, 4.0, 5.0), row(14.0, 4.1, 4.0, 20.0)]
    found = dict(tension_cost.advice(tension_cost.points(rows)))
    assert found[0.1]["radius"] == 7.0
    assert found[0.05]["radius"] == 14.0  # at 7 d it is luck: 10 d is 7.5 % off
    assert found[0.025]["radius"] == 14.0
    assert tension_cost.advice(tension_cost.points([row(10.0, 8.0, 4.0, 1.0)]))[0][1] is None
