"""Every scene has a step in which no particle goes far."""

import numpy as np
import pytest

import refsim as rs
from refsim import make_plan
from refsim.core.effect import Extremes
from refsim.engine.limits import stable_steps, step_limits
from tests import pairs

D, H = 0.1, 0.25


def scene(*effects, velocity=(0.0, 0.0, 0.0), **more):
    fluid = (rs.Box(cells=(3, 3, 1), velocity=velocity),)
    return rs.Scene(**{"spacing": D, "support_radius": H, "dim": 2, "fluid": fluid, "effects": effects} | more)


SCENES = {name: pairs.scene(name, name) for name in pairs.EFFECTS} | {
    "nothing": scene(), "gravity alone": scene(rs.Gravity(acceleration=(0.0, -9.81, 0.0))),
    "a solid without stiffness": scene(
        rs.ShapeMatching(stiffness=0.0), fluid=(), dim=3, solid=(rs.SolidBox(lower=(0, 0, 0), upper=(0.3, 0.3, 0.3)),)
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
def test_no_particle_crosses_its_support_in_a_step(name):
    """However fast particles are: some limit sees their speed."""
    plan, speed = make_plan(SCENES[name]), 1e9
    longest = min(stable_steps(step_limits(plan), Extremes(speed, 0.0)).values())
    assert longest * speed <= 0.6 * max(plan.grid.support_radius, 2 * plan.grid.spacing)


def test_free_flight_and_free_fall_end_where_they_should():
    """x0 + v t + g t^2/2 of the time that is reached, in steps of half a spacing at most; none goes beyond the end."""
    pull, velocity = np.array([1.0, -9.81, 0.0]), np.array([3.0, 4.0, 0.0])
    for gravity in ((), (rs.Gravity(acceleration=tuple(pull)),)):
        run = rs.Simulation(scene(*gravity, velocity=tuple(velocity), end_time=0.2, dtype="float64"), "numpy")
        place = start = run.field("position")
        while run.time < 0.2:
            run.step()
            last, place = place, run.field("position")
            assert np.linalg.norm(place - last, axis=1).max() < 0.6 * D
        fallen = velocity * run.time + 0.5 * run.time**2 * pull * bool(gravity)
        assert run.steps >= 15
        assert np.abs(place - start - fallen).max() < (1e-12 if not gravity else 0.02 * D)
    heat = rs.HeatConduction(conductivity=1.0, temperature=20.0, density=1000.0, heat_capacity=1000.0)
    run = rs.Simulation(scene(heat, end_time=10.0), "numpy")
    run.step()
    assert (run.time, run.last.limiter) == (10.0, "resting")
