"""Inputs and closed form of one-way coupling."""

import math

import numpy as np

from refsim.boundary.one_way_coupling import WallViscosity
from refsim.boundary.walls import WallParticles
from refsim.cases import Case, Exact, closed_form, groups


@groups("wall_viscosity")
def _wall_viscosity(case, grid):
    return {"wall_viscosity": WallViscosity(grid.real(0.7))}


@closed_form("one_way_coupling.wall_viscosity")
def rubbing_on_one_particle():
    """h = 2 m, r = 1 m: lap W = 45/(pi h^6) (h - r); a = -mu rho0 V_b lap W/rho^2 v."""
    case = Case(
        "rubbing", 3, np.zeros((1, 3)), spacing=1.0, support_radius=2.0, wall_position=np.array([[0.0, 0.6, 0.8]])
    )
    velocity = np.array([[1.0, -2.0, 0.5]])
    drag = 3.0 * 1000 * 0.25 * 45 / (math.pi * 64) / 500.0**2
    return Exact(
        case,
        {
            "walls": WallParticles(case.wall_position, np.array([0.25])),
            "velocity": velocity,
            "density": np.array([500.0]),
            "wall_viscosity": WallViscosity(3.0),
        },
        {"acceleration": -drag * velocity},
    )
