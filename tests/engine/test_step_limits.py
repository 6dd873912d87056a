"""Every scene has a step in which no particle goes far."""

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
