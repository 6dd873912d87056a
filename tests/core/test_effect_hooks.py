"""What is registered: operations on their references, and what an effect may bring beside forces."""

from typing import ClassVar

import numpy as np
import pytest

from refsim import Box, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core import operation as core
from refsim.core.effect import PLACE, Effect, Field, Pass, StepLimit

MARK = Field("mark", "-", "a number of the particle's own", state=True)
TABLE = Field("table", "m/s^2", "an acceleration", rows=3, state=True)


class Extra(Effect, frozen=True, kw_only=True):
    """An effect of this test: marks particles, keeps a table, moves particles by a leap-frog of its own."""

    name: ClassVar[str] = ""

    def fields(self, others):
        return (MARK, TABLE, PLACE)

    def initial(self, grid, state, others):
        return {"mark": state.position[:, 0], "table": np.arange(3)}

    def passes(self, others):
        first = Pass("sph.gravity", updates=("acceleration",), names={"field": "table"}, stage="motion")
        move = Pass("sph.kick_drift", updates=("velocity", "position"), stage="motion")
        return move, first

    def step_limits(self, grid, others):
        return {"extra": StepLimit.constant(2e-4)}


Extra.name = "extra"


def test_values_tables_and_places():
    liquid = WeaklyCompressible(sound_speed=12.0, clamp_pressure=False, density="summation")
    effects = (liquid, Gravity(), Extra())
    scene = Scene(spacing=0.1, support_radius=0.21, fluid=(Box(cells=(5, 5, 5)),), effects=effects)
    simulation = Simulation(scene, "cpu")
    start = simulation.field("position")[:, 0].copy()
    for _ in range(40):
        assert simulation.step().limiter == "extra"
    assert (simulation.field("mark") == start).all(), "a state field stays with its particle"
    assert simulation.field("table").tolist() == [0, 1, 2]
    identity, place = (simulation.backend.host(simulation.fields[k]) for k in ("identity", "place"))
    assert (identity[place] == np.arange(simulation.count)).all()


@pytest.fixture
def reference(monkeypatch):
    """A function of the package `made_up`, with a registry of its own."""
    monkeypatch.setattr(core, "REGISTRY", {})

    def speed(distance):
        return {"speed": (distance, distance)}

    speed.__module__ = "made_up.operations"
    return speed


def test_names_follow_from_the_folder_and_the_function(reference):
    assert core.operation("v = x/t", paper="standard", outputs="speed")(reference) is reference
    (found,) = core.REGISTRY.values()
    plain = core.Operation("made_up.speed", "made_up", "standard", "v = x/t", "speed", ("speed",))
    assert found == plain
