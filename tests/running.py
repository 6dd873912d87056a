"""Runs that go on for some steps or to a time."""


def advanced(simulation, steps):
    """The simulation after so many further steps."""
    for _ in range(steps):
        simulation.step()
    return simulation


def run_to(simulation, time):
    """The simulation at the first step that reaches a time [s]."""
    while simulation.time < time:
        simulation.step()
    return simulation
