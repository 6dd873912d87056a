"""The penetration correction on solids: no particle enters at any step."""

import numpy as np
import pytest
import trimesh

from refsim import Box, Cloud, Gravity, InputError, MeshBoundary, Scene, Simulation, WeaklyCompressible, make_plan
from tests.running import advanced

SPACING = 0.01
LIQUID = WeaklyCompressible(
    sound_speed=20.0, dynamic_viscosity=0.5, density_bound=1e3, density="summation"
)  # particles at a point


@pytest.fixture(scope="module")
def plate(tmp_path_factory):
    """A horizontal plate, half a spacing thick."""
    path = tmp_path_factory.mktemp("meshes") / "plate.obj"
    trimesh.creation.box((0.1, 0.1, 0.005)).export(path)
    return str(path)


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    path = tmp_path_factory.mktemp("meshes") / "ball.obj"
    trimesh.creation.icosphere(subdivisions=3, radius=0.04).export(path)
    return str(path)


def bullets(file, correction, speed, **changes):
    """Particles far apart that move down onto the solid by `speed` spacings in a step of 0.2 ms."""
    x, y = np.meshgrid(np.arange(-3, 4), np.arange(-3, 4))
    at = np.stack([0.012 * x.ravel(), 0.012 * y.ravel(), np.full(x.size, 0.045)], axis=1)
    at[:, 2] += 0.1 * SPACING * np.arange(x.size) % SPACING
    fluid = Cloud(position=at, velocity=(0.0, 0.0, -speed * SPACING / 2e-4))
    # As printed, boundary particles repel lone particles least, so the test isolates the correction.
    given = {"literal": ("E30",), "field_spacing": 0.0025, **changes}
    boundary = MeshBoundary(file=file, correction=correction, **given)
    return Simulation(
        Scene(spacing=SPACING, support_radius=0.011, fluid=(fluid,), effects=(LIQUID, boundary), step=2e-4), "numpy"
    )


def through(simulation, steps):
    """Number of particles that passed below the solid."""
    advanced(simulation, steps)
    return int((simulation.field("position")[:, 2] < -0.003).sum())


@pytest.mark.parametrize("speed", [0.3, 2.0, 4.0])
def test_only_the_swept_correction_holds_a_plate_thinner_than_a_step(plate, speed):
    assert through(bullets(plate, "swept", speed), 30) == 0
    if speed > 1:
        assert through(bullets(plate, "point", speed), 30) > 0
    assert through(bullets(plate, "none", speed), 30) > 0


def test_liquid_inside_the_solid_is_refused(ball):
    effects = (LIQUID, Gravity(), MeshBoundary(file=ball))
    for cells, remedy in (
        ((4, 4, 8), "move the solid or the particles"),
        ((4, 4, 2), "a mesh is a solid: give a container"),
    ):
        block = Box(lower=(-0.02, -0.02, 0.0), cells=cells)
        with pytest.raises(InputError, match=f"start inside the solid of .*; {remedy}"):
            make_plan(Scene(spacing=SPACING, support_radius=0.026, fluid=(block,), effects=effects))
