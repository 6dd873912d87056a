"""Forces that a user adds in Python: on the run's own arrays, seen by every backend, refused where they cannot be."""

import math

import numpy as np
import pytest

import refsim as rs
from refsim.backends.arrays import unavailable
from refsim.core.errors import InputError

RATE = 2.0


def falling(**more):
    """One particle that falls; `more` of the scene."""
    return rs.Scene(
        spacing=0.1, support_radius=0.26, dtype="float64", step=1e-3, end_time=1.0,
        fluid=(rs.Box(lower=(0.0, 0.0, 0.0), cells=(1, 1, 1)),),
        effects=(rs.Gravity(acceleration=(0.0, 0.0, -9.81)),), **more,
    )  # fmt: skip


@pytest.mark.parametrize("backend", ["numpy", "cpu", "cuda"])
def test_drag_in_python_reaches_the_speed_of_the_closed_form(backend):
    """v = -(g/k) (1 - exp(-k t)), up to the step; the force gets the run's own arrays, which CuPy shares."""
    shared = np.asarray
    if backend == "cuda":
        shared = pytest.importorskip("cupy", reason="CuPy is not installed").asarray
        if unavailable("cuda") is not None:
            pytest.skip("there is no GPU here")
    simulation, given = rs.Simulation(falling(), backend), []

    def drag(time, fields):
        given.append((time, fields["acceleration"]))
        acceleration = shared(fields["acceleration"])
        acceleration[...] -= RATE * shared(fields["velocity"])

    simulation.add_force(drag)
    while simulation.time < 0.5:
        simulation.step()
    wanted = -9.81 / RATE * (1 - math.exp(-RATE * simulation.time))
    assert simulation.field("velocity")[0, 2] == pytest.approx(wanted, rel=2e-3)
    assert given[0][1] is simulation.fields["acceleration"]
    assert len({time for time, _ in given}) == simulation.steps
    assert simulation.field("acceleration")[0, 2] == pytest.approx(
        -9.81 - RATE * simulation.field("velocity")[0, 2], rel=1e-12
    )  # of the present state


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
