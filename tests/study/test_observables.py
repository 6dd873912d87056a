"""Observables against other programs, and what is said of those that are not there."""

import pytest

from refsim import Box, Gravity, InputError, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.engine.conserved_totals import conserved_totals
from refsim.study.observables import observable_of
from tests.running import rows
from validation.metrics.dam_break import front_position


@pytest.fixture(scope="module")
def simulation():
    """A block that flies, and a piece apart from it."""
    scene = Scene(
        dim=2, dtype="float64", spacing=0.01, support_radius=0.026,
        fluid=(Box(cells=(8, 6, 1), velocity=(2.0, 1.0, 0.0)), Box(lower=(0.3, 0.0, 0.0), cells=(2, 2, 1))),
        effects=(WeaklyCompressible(sound_speed=20.0, density="summation"), Gravity(acceleration=(0.0, -9.81, 0.0))),
    )  # fmt: skip
    made = Simulation(scene, "numpy")
    made.step()
    return made


def value(simulation, name):
    return observable_of(name, simulation.plan)(simulation)


def test_front_and_energy_are_those_of_the_report_and_a_lonely_point_has_none(simulation):
    position = simulation.field("position")
    found = front_position(position, 0.01)
    assert found.detached
    assert value(simulation, "front") == pytest.approx(found.connected, rel=1e-12)
    assert value(simulation, "front:+x") < found.farthest
    assert value(simulation, "front:-y") == pytest.approx(-front_position(-position, 0.01, axis=1).connected, rel=1e-12)
    assert value(simulation, "kinetic_energy") == pytest.approx(
        conserved_totals(simulation)["kinetic_energy"], rel=1e-12
    )
    with pytest.raises(InputError, match="no particle is within the support radius"):
        value(simulation, "field:density@5,5")


@pytest.mark.parametrize("name, words", rows(__file__, "missing_observables"))
def test_what_is_not_there_gets_a_sentence(simulation, name, words):
    with pytest.raises(InputError, match=words):
        observable_of(name, make_plan(simulation.plan.scene))
