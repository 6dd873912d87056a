"""Passes of a step that need nothing of each other are branches of its graph; all others keep their order."""

import types

import pytest

from refsim import make_plan
from refsim.backends import device, runtime
from refsim.core.effect import Pass
from refsim.engine.binding import Accesses, accesses, needed_before
from validation.experiments.melting.scene import scene_of


def launch(taken, changed):
    return Accesses(frozenset((taken + changed).split()), frozenset(changed.split()))


def test_a_launch_waits_for_what_it_reads_and_for_what_reads_what_it_changes():
    launches = [
        launch("", "a"), launch("", "b"), launch("a ", "c"), launch("a b ", "d"), launch("d ", "a"), None,
        launch("", "e"),
    ]  # fmt: skip
    assert needed_before(launches) == [(), (), (0,), (0, 1), (2, 3), (4,), (5,)]
    heat, force = accesses(Pass("heat.chebyshev"), "cuda"), accesses(Pass("jiang_zhu_2023.cohesion"), "cuda")
    assert needed_before([launch("x ", "y"), launch("x ", "z")]) == [(), ()]
    assert "scratch" in heat.changed
    assert "position" in heat.taken
    assert "position" not in heat.changed
    assert "temperature" in heat.changed
    assert force.changed == {"acceleration"}


def test_heat_and_solids_of_a_melting_step_run_side_by_side():
    plan = make_plan(scene_of("figure_4", 0.2))
    order = [p.operation for _, p in plan.motion]
    before = needed_before([accesses(p, "cuda") for _, p in plan.motion])
    heat, solids = order.index("heat.chebyshev"), [order.index(f"shape_matching.{n}") for n in ("pull", "damp")]
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
