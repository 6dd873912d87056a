"""Laws of scenes drawn at random: they read units, find planted faults, and hold where nothing is planted."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings

from refsim import sph
from refsim.core.effect import EFFECTS
from refsim.scene.files import describe, unit_of
from validation.__main__ import main
from validation.laws import laws
from validation.laws.command import campaign, table
from validation.laws.scenes import drawn
from validation.laws.units import SYMBOLS, Unit, scaled, unit


def test_units_are_read():
    assert unit("W/(m K)") == Unit(1, -3, 1, -1)
    assert unit("kg/m^3; kg/m^2 in 2D", 2) == Unit(-3, 0, 1, 0)  # masses of the plane are those of a metre of depth
    assert unit("kg; kg/m in 2D", 2) == Unit(-1, 0, 1, 0)
    assert unit("m^4/(kg s^2)") == Unit(4, -2, -1, 0)
    assert unit("degrees") == Unit(0, 0, 0, 0)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_every_unit_of_an_effect_is_known(name):
    import re

    words = {unit_of(text) for key, text in describe(EFFECTS[name]).items() if key != "literal"} - {None}
    known = {*SYMBOLS, "deg", "degrees", "cells", "in", "D", "c", "h"}
    assert {symbol for each in words for symbol in re.findall("[A-Za-z]+", each)} <= known


def test_a_scene_in_other_units_comes_back():
    @settings(max_examples=10, database=None, deadline=None, suppress_health_check=list(HealthCheck))
    @seed(1)
    @given(drawn())
    def there_and_back(case):
        factors = Unit(2.0, 8.0, 0.5, 4.0)
        again = scaled(scaled(case.scene, factors), Unit(*(1 / f for f in factors)))
        assert again.spacing == case.scene.spacing
        np.testing.assert_array_equal(again.fluid[0].position, case.scene.fluid[0].position)
        assert [*map(repr, again.effects)] == [*map(repr, case.scene.effects)]

    there_and_back()


FAULTS = {
    "units": (sph, "central_coefficient", lambda mu, dim: (dim + 2) * mu + 1e-3),  # an epsilon without a scale
    "exact": (sph.Gravity, "prepare", lambda self, grid, others: {"field": np.array(self.acceleration) * 1.001}),
    "told is counted": (sph.WeaklyCompressible, "particle_mass", lambda self, grid: 1.1 * grid.spacing**grid.dim),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_planted_fault_is_found(name, monkeypatch):
    where = "gravity" if name == "exact" else "weakly_compressible"
    assert not campaign([name], [where], 0.1, 3, "numpy").breaks
    monkeypatch.setattr(*FAULTS[name])
    assert campaign([name], [where], 3.0, 3, "numpy").breaks


def test_a_law_is_short_and_told_in_the_table(capsys):
    import inspect

    for each in (law for group in laws.LAWS.values() for law in group):
        assert len(inspect.getsource(each).splitlines()) <= 50
        assert each.__doc__
    assert main(["laws", "--minutes", "0.001", "--seed", "2", "--law", "told is counted"]) == 0
    assert "told is counted" in capsys.readouterr().out
    assert main(["laws", "--minutes", "-1"]) == 2
    assert "held" in table(campaign(["told is counted"], [None], 0.0, 1, "numpy"))
