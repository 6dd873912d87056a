"""Inputs and closed forms of one-way coupling."""

import math
from pathlib import Path

import numpy as np

from refsim.boundary.one_way_coupling import MeshBoundary
from refsim.core.cases import Exact, at, closed_form, example, groups, takes
from refsim.core.walls import WallMotion, WallParticles, WallViscosity
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import Fluid, WallFrameGravity

PEBBLE = Path(__file__).parents[2] / "examples" / "pebble.obj"
example(
    MeshBoundary(file=str(PEBBLE), center=(0.2, -0.17, 0.2), size=0.4, viscosity=0.1, adhesion=0.1),
    brings="corrections",
)


groups(wall_viscosity=lambda case, grid: WallViscosity(grid.real(0.7)))


FAR = np.full(3, np.inf)
VELOCITY, WALL = np.array([[1.0, -2.0, 0.5]]), np.array([3.0, 0.0, -1.0])


def _rubbed(name, place, volume, parting, motion=None):
    """h = 2 m, r = 1 m: lap W = 45/(pi h^6) (h - r); a = mu rho0 lap W/rho^2 sum_b V_b (v_b - v), `volume` in 1/4 m^3.

    `parting` [m/s] is the sum without the quarter.
    """
    drag = 3.0 * 1000 * 0.25 * 45 / (math.pi * 64) / 500.0**2
    inputs = {
        "walls": WallParticles(np.array(place), 0.25 * np.array(volume)), "velocity": VELOCITY, "density": [500.0],
        "wall_viscosity": WallViscosity(3.0), "wall_motion": motion,
    }  # fmt: skip
    return Exact(at(name, [0, 0, 0], place), inputs, {"acceleration": drag * parting})


closed_form(
    "one_way_coupling.wall_viscosity",
    rubbing_on_one_particle=lambda: _rubbed("rubbing", [[0.0, 0.6, 0.8]], [1], -VELOCITY),
    # one beyond the plane z = 0.5, which moves, and one before it at the same distance
    dragged_by_one_particle=lambda: _rubbed(
        "dragged",
        [[0.0, 0.6, 0.8], [0.0, 0.6, -0.8]],
        [1, 1],
        WALL - 2 * VELOCITY,
        WallMotion(-FAR, np.array([np.inf, np.inf, 0.5]), WALL),
    ),
    # one below the plane of each axis, and two between the planes of two axes, at rest; none stands for another one
    dragged_from_below=lambda: _rubbed(
        "dragged_from_below",
        [[-1, 0, 0], [0, -1, 0], [0.6, 0, -0.8], [-0.85, 0.2775**0.5, 0], [0.4375**0.5, -0.75, 0]],
        np.arange(1, 6),
        6 * WALL - 15 * VELOCITY,
        WallMotion(np.array([-0.9, -0.8, -0.7]), FAR, WALL),
    ),
)


@groups("wall_motion")
def _wall_motion(case, grid):
    """Beyond a plane that parts the wall particles; moving across it would be no shear, so along x and y."""
    plane = FAR.copy()
    plane[0] = np.median(case.wall_position[:, 0]) + 0.01 * case.spacing if len(case.wall_position) else 0.0
    velocity = np.array([1.5, -0.5, 0.25 if case.dim == 3 else 0.0])
    return {"wall_motion": WallMotion(*(v.astype(grid.dtype) for v in (-FAR, plane, velocity)))}


takes("one_way_coupling.wall_pressure", fluid="rest_density clamp gradient_share")  # p_b counts once
takes("one_way_coupling.wall_viscosity", smoothing="support_radius dim")


def _pushing(w, pressure, gravity, expected, clamp, turning=None):
    """h = 2 m, r = 1 m, alone: a = Psi_b p_b/rho^2 W'(r) e_b, with p_b as `expected` [Pa]."""
    case = at("pushing", [0, 0, 0], [[0.0, 0.6, 0.8]])
    push = 1000 * 0.25 * expected / 500.0**2 * w.slope
    inputs = {
        "walls": WallParticles(case.wall_position, np.array([0.25])), "density": [500.0], "pressure": [pressure],
        "lean": WallFrameGravity(*gravity), "fluid": Fluid(1000.0, 4e5, 1, clamp), "turning": turning,
    }  # fmt: skip
    return Exact(case, inputs, {"acceleration": -push * case.wall_position})


for_each_kernel(
    "one_way_coupling.wall_pressure",
    # p_b = p_i + rho0 g.(x_b - x_i)
    pushed_by_one_particle=lambda w: _pushing(
        w, 2000.0, (2.0, -1.0, 3.0), 2000.0 + 1000 * (0.6 * -1.0 + 0.8 * 3.0), False
    ),
    # 3/s about an axis along z by (0, 2) m: centrifugal -18 m/s^2 along y
    in_a_tank_that_turns=lambda w: _pushing(
        w,
        2000.0,
        (2.0, 17.0, 3.0),
        2000.0 + 1000 * (0.6 * -1.0 + 0.8 * 3.0),
        False,
        [0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 2.0, 5.0],
    ),
    # p_b = 0.5 - 0.25 Pa, and 0.25 - 0.5 Pa, clamped
    pushed_below_a_pascal=lambda w: _pushing(w, 0.5, (0.0, -1 / 2400, 0.0), 0.25, True),
    clamped_below_zero=lambda w: _pushing(w, 0.25, (0.0, 0.0, -1 / 1600), 0.0, True),
)
