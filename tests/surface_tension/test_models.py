"""Surface-tension models beside Jiang & Zhu's: shapes of their forces, momenta, internal pressure, printed readings."""

import pytest

import refsim as rs
from refsim import make_plan
from tests.running import rows


def notes_with(plan, words):
    """Notes of a plan that contain the words."""
    return [note for note in plan.notes if words in note]


@pytest.mark.parametrize(("name", "parameters", "words"), rows(__file__, "bad_models"))
def test_bad_parameters_get_one_sentence(name, parameters, words):
    model = getattr(rs, name)
    fluid = rs.WeaklyCompressible(rest_density=1.0, sound_speed=100.0, density="summation")
    box = rs.Box(cells=(3, 3, 3))
    with pytest.raises(rs.InputError) as error:
        make_plan(rs.Scene(spacing=1.0, support_radius=2.7, fluid=(box,), effects=(fluid, model(**parameters))))
    assert words in str(error.value)
    assert str(error.value).startswith(f"{model.name}: ")


def beside_akinci(fluid):
    """27 particles of this liquid under Akinci's tension."""
    effects = (fluid, rs.Akinci2013(surface_tension=1.0))
    return rs.Scene(spacing=1.0, support_radius=2.6, fluid=(rs.Box(cells=(3, 3, 3)),), effects=effects)


def test_a_coefficient_on_an_advanced_density_is_noted_and_restoring_only_there():
    summed = rs.WeaklyCompressible(sound_speed=10.0, density="summation", restoring=0.3)
    with pytest.raises(
        rs.InputError, match=r"restoring = 0.3 is for an advanced density, and this one is summed; leave"
    ):
        make_plan(beside_akinci(summed))
    for density, restoring, noted in (("continuity", 0.3, 1), (None, 0.003, 0)):
        fluid = rs.WeaklyCompressible(sound_speed=100.0, dynamic_viscosity=10.0, density=density)
        plan = make_plan(beside_akinci(fluid))
        assert plan.effects["weakly_compressible"].restoring == restoring
        assert len(notes_with(plan, "calibrate(..., density = 'continuity')")) == noted
