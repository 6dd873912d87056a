"""The state of a run is an argument of what works on it: none of its parts holds it."""

import refsim as rs
from refsim.engine.state import State
from tests.motion.test_motions import SWAY, tank


def held(value, seen):
    """Every object of the engine, and every container, that can be reached from a value."""
    if id(value) in seen:
        return
    seen[id(value)] = value
    if isinstance(value, dict):
        inside = value.values()
    elif isinstance(value, list | tuple | set | frozenset):
        inside = value
    else:
        own = type(value).__module__.startswith("refsim.engine")
        inside = getattr(value, "__dict__", {}).values() if own else ()
    for part in inside:
        held(part, seen)


def test_no_part_holds_the_run():
    """With an audit of driven energy, gauges and motions."""
    gauges = (rs.Gauge(name="floor", kind="force", on="-y"), rs.Gauge(name="p", kind="pressure", at=(0.5, 0.1, 0.0)))
    walls = {"viscosity": 1.0, "velocity": (0.1, 0.0, 0.0), "moving_faces": ("-y",)}
    scene = tank(5, (SWAY,), gauge=gauges, walls=walls).with_(energy_audit=rs.EnergyAudit(every=1, bound=1e9))
    simulation = rs.Simulation(scene, "numpy")
    simulation.step()
    seen = {}
    for name in ("auditor", "balances", "counting", "gauges", "lists", "motions", "order", "timings"):
        held(getattr(simulation, name), seen)
    assert id(simulation.auditor.driving.forces) in seen
    assert not [value for value in seen.values() if isinstance(value, State)]
