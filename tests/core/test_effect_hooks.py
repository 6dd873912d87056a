"""What an effect may bring beside forces: values at the start, tables, passes once the step's length is known."""

from typing import ClassVar

import numpy as np
import pytest

from refsim import Box, Gravity, InputError, Scene, Simulation, WeaklyCompressible, make_plan
from refsim.core.effect import Effect, Pass, StepLimit
from refsim.core.fields import PLACE, Field

LIQUID = WeaklyCompressible(sound_speed=12.0, clamp_pressure=False, density="summation")
MARK = Field("mark", "-", "a number of the particle's own", state=True)
TABLE = Field("table", "m/s^2", "an acceleration", rows=3, state=True)


class Extra(Effect, frozen=True, kw_only=True):
    """An effect of this test: marks particles, keeps a table, moves particles by a leap-frog of its own."""

    name: ClassVar[str] = ""
    moves: bool = True
    shape: int = 3

    def fields(self, others):
        return (MARK, TABLE, PLACE)

    def initial(self, grid, state, others):
        return {"mark": state.position[:, 0], "table": np.arange(self.shape)}

    def passes(self, others):
        first = Pass("sph.gravity", updates=("acceleration",), names={"field": "table"}, stage="motion")
        move = Pass("sph.kick_drift", updates=("velocity", "position"), stage="motion")
        return (move, first) if self.moves else (first,)

    def step_limits(self, grid, others):
        return {"extra": StepLimit.constant(2e-4)}


class Other(Extra, frozen=True, kw_only=True):
    """A second one."""

    name: ClassVar[str] = ""


Extra.name, Other.name = "extra", "other"


def scene(*effects, **options):
    return Scene(spacing=0.1, support_radius=0.21, fluid=(Box(cells=(5, 5, 5)),), effects=effects, **options)


def test_values_tables_and_places():
    simulation = Simulation(scene(LIQUID, Gravity(), Extra()), "cpu")
    start = simulation.field("position")[:, 0].copy()
    for _ in range(40):
        assert simulation.step().limiter == "extra"
    assert (simulation.field("mark") == start).all(), "a state field stays with its particle"
    assert simulation.field("table").tolist() == [0, 1, 2]
    identity, place = (simulation.backend.host(simulation.fields[k]) for k in ("identity", "place"))
    assert (identity[place] == np.arange(simulation.count)).all()


def test_motion_comes_last_and_acts():
    """The table is added to the acceleration after the forces: velocities differ by its share of the step."""
    plan = make_plan(scene(LIQUID, Extra()))
    assert [p.operation for _, p in plan.motion] == ["sph.gravity", "sph.kick_drift"]
    assert plan.launches()[-2:] == ("sph.gravity", "sph.kick_drift")
    effect, leap_frog = make_plan(scene(LIQUID, Extra(moves=False))).motion[-1]
    assert (effect, leap_frog.operation) == (None, "sph.kick_drift")
    with pytest.raises(InputError, match="would both move the particles; keep one"):
        make_plan(scene(LIQUID, Extra(), Other()))
    step, velocity = 2e-4, []
    for effects in ((Extra(),), ()):
        simulation = Simulation(scene(LIQUID, *effects, step=step, dtype="float64"), "numpy")
        simulation.step()
        velocity.append(simulation.field("velocity"))
    assert np.allclose(velocity[0] - velocity[1], 0.5 * step * np.array([0.0, 1.0, 2.0]), atol=1e-15)
    with pytest.raises(ValueError, match="gives 'table' the shape"):
        make_plan(scene(LIQUID, Extra(shape=4)))
