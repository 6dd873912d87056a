"""Forces that a user adds in Python: on the run's own arrays, seen by every backend, refused where they cannot be."""

import numpy as np
import pytest

import refsim as rs
from refsim.core.errors import InputError


def falling(**more):
    """One particle that falls; `more` of the scene."""
    return rs.Scene(
        spacing=0.1, support_radius=0.26, dtype="float64", step=1e-3, end_time=1.0,
        fluid=(rs.Box(lower=(0.0, 0.0, 0.0), cells=(1, 1, 1)),),
        effects=(rs.Gravity(acceleration=(0.0, 0.0, -9.81)),), **more,
    )  # fmt: skip


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
