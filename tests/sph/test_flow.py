"""Tension too large for its sound speed, and terms that hold no drop together, are noted."""

import pytest

import refsim as rs
from refsim import make_plan
from refsim.surface_tension.calibration import BESIDE, SETTINGS
from refsim.surface_tension.cohesion import KEEPS_DENSITY

# Tension


def drop(*effects, sound=1.0, dim=3):
    liquid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=sound, dynamic_viscosity=1.0, density="summation")
    cells = (6, 6, 6 if dim == 3 else 1)
    return rs.Scene(dim=dim, spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=cells),), effects=(liquid, *effects))


def stiff_notes(made):
    return [note for note in make_plan(made).notes if "sigma/(rho0 c^2 d)" in note]


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("model", [name for name in SETTINGS if name not in BESIDE])
def test_a_tension_too_large_for_its_sound_speed_is_noted(model, dim):
    limit = {"csf": 0.015, "he": 0.004}.get(model, KEEPS_DENSITY)
    effect = SETTINGS[model][1]
    (note,) = stiff_notes(drop(effect(1.01 * limit), dim=dim))
    assert f"= {1.01 * limit:.2g} is above {limit:g}" in note
    advised = float(note.split("sound_speed of at least ")[1].split()[0])
    assert 1.0 < advised < 1.02
    assert not stiff_notes(drop(effect(1.01 * limit), sound=advised, dim=dim))
    assert not stiff_notes(drop(effect(limit), dim=dim))
    assert not stiff_notes(drop(effect(100 * limit), rs.ImplicitPressure(), dim=dim))


def test_terms_that_hold_no_drop_together_say_so():
    for effect in (rs.NormalDifference2014(area_acceleration=1e-6), rs.Akinci2013(gamma=0.0, area_acceleration=1e-6)):
        assert any("alone holds no drop together" in note for note in make_plan(drop(effect)).notes)
    assert not make_plan(drop(rs.NormalDifference2014(area_acceleration=0.0))).notes[1:]  # the viscosity's
