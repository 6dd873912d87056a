"""A step: branches of its graph, its limits, and forces that a user adds in Python."""

import types

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.backends import device, runtime
from refsim.core.effect import Extremes
from refsim.core.errors import InputError
from refsim.engine.binding import accesses, needed_before
from refsim.engine.limits import stable_steps, step_limits
from tests import pairs
from validation.experiments.melting.scene import scene_of


def test_heat_and_solids_of_a_melting_step_run_side_by_side():
    plan = make_plan(scene_of("figure_4", 0.2))
    order = [p.operation for _, p in plan.motion]
    before = needed_before([accesses(p, "cuda") for _, p in plan.motion])
    heat, solids = order.index("heat.implicit"), [order.index(f"shape_matching.{n}") for n in ("pull", "damp")]
    assert (before[heat], before[solids[0]], set(before[order.index("sph.kick_drift")])) == ((), (), {heat, solids[1]})


class FakeStream:
    """Notes which events a branch waits for."""

    def __init__(self, number, log):
        self.number, self.log = number, log

    def wait_event(self, event):
        self.log.append(("wait", self.number, event))


@pytest.mark.skipif(runtime.simulated(), reason="the simulator records no graph")
def test_a_graph_waits_where_calls_need_each_other(monkeypatch):
    """Calls 0 and 1 are branches, 2 needs both and stands behind 0; all branches end in the first."""
    log, events = [], iter(range(100))
    library = types.SimpleNamespace(
        cuda=types.SimpleNamespace(
            Event=lambda disable_timing: types.SimpleNamespace(number=next(events), record=lambda stream: None)
        )
    )
    monkeypatch.setattr(device, "cupy_or_numpy", lambda: library)
    monkeypatch.setattr(device, "own_stream", lambda: FakeStream(runtime.branch(), log))
    monkeypatch.setattr(device, "_recording", True)
    calls = [lambda k=k: log.append(("call", runtime.branch(), k)) for k in range(4)]
    device.launch_after(calls, [(), (), (0, 1), (1,)])
    seen = [(kind, branch, getattr(what, "number", what)) for kind, branch, what in log]
    # event 0 is where the calls begin, event 1 + k the end of call k
    assert seen == [
        ("call", 0, 0), ("wait", 1, 0), ("call", 1, 1), ("wait", 0, 2), ("call", 0, 2), ("call", 1, 3), ("wait", 0, 4),
    ]  # fmt: skip
    assert runtime.branch() == 0


SMALL = {"spacing": 0.1, "support_radius": 0.25}
SHEET = {**SMALL, "dim": 2, "fluid": (rs.Box(cells=(3, 3, 1)),)}
SOFT = (rs.SolidBox(lower=(0, 0, 0), upper=(0.3, 0.3, 0.3)),)


SCENES = {name: pairs.scene(name, name) for name in pairs.EFFECTS} | {
    "nothing": rs.Scene(**SHEET, effects=()),
    "gravity alone": rs.Scene(**SHEET, effects=(rs.Gravity(),)),
    "a solid without stiffness": rs.Scene(**SMALL, fluid=(), solid=SOFT, effects=(rs.ShapeMatching(stiffness=0.0),)),
}


@pytest.mark.parametrize("name", SCENES)
def test_no_particle_crosses_its_support_in_a_step(name):
    """However fast particles are: some limit sees their speed."""
    plan, speed = make_plan(SCENES[name]), 1e9
    longest = min(stable_steps(step_limits(plan), Extremes(speed, 0.0)).values())
    assert longest * speed <= 0.6 * max(plan.grid.support_radius, 2 * plan.grid.spacing)


def falling():
    """One particle that falls."""
    given = {"spacing": 0.1, "support_radius": 0.26, "dtype": "float64", "step": 1e-3}
    return rs.Scene(fluid=(rs.Box(cells=(1, 1, 1)),), effects=(rs.Gravity(),), **given)


def test_two_forces_add_up_and_what_cannot_be_is_refused():
    simulation = rs.Simulation(falling(), "numpy")
    for share in (1.0, 2.0):
        simulation.add_force(lambda time, fields, share=share: np.add(
            fields["acceleration"], [share, 0, 0], out=fields["acceleration"]
        ))  # fmt: skip
    simulation.step()
    assert simulation.field("acceleration")[0].tolist() == [3.0, 0.0, -9.81]
    simulation = rs.Simulation(falling(), "numpy")
    with pytest.raises(InputError, match=r"add_force: force = 3 is a whole number; give a function"):
        simulation.add_force(3)
    simulation.step()
    with pytest.raises(InputError, match=r"add_force: the run has begun"):
        simulation.add_force(print)
