"""Inputs and closed forms of the viscous forces."""

import numpy as np

from refsim.core.cases import Exact, groups
from refsim.smoothing.cases import for_each_kernel
from refsim.sph.viscosities import ArtificialViscosity, LaminarViscosity


@groups("artificial_viscosity", "laminar_viscosity")
def _viscosities(case, grid):
    """c = 20 m/s, and smoothing lengths of half the support radius."""
    h = 0.5 * grid.support_radius
    return {
        "artificial_viscosity": ArtificialViscosity(*map(grid.real, (0.3, 2.0, 20.0, h))),
        "laminar_viscosity": LaminarViscosity(*map(grid.real, (0.5, h))),
    }


# Two particles 1 m apart along y, which approach at 2 m/s; the smoothing length is 1 m.
GIVEN = {
    "mass": [2.0, 3.0], "density": [800.0, 1200.0], "velocity": np.array([[7.0, 2.0, 0.0], [3.0, 0.0, -5.0]]),
    "artificial_viscosity": ArtificialViscosity(0.5, 2.0, 10.0, 1.0), "laminar_viscosity": LaminarViscosity(0.5, 1.0),
}  # fmt: skip


@for_each_kernel("viscosities.artificial", across=5.0)
def approaching_pair(w):
    """mu = -2/1.01, Pi = (2 mu^2 - 5 mu)/1000: a_1 = -m_2 Pi |W'(h/2)| along y."""
    mu = -2 / 1.01
    push = (2 * mu**2 - 5 * mu) / 1000 * w.slope
    return Exact(w.pair, GIVEN, {"acceleration": push * np.array([[0, -3.0, 0], [0, 2.0, 0]])})


@for_each_kernel("viscosities.artificial")
def parting_pair(w):
    """None."""
    return Exact(w.pair, GIVEN | {"velocity": -GIVEN["velocity"]}, {"acceleration": np.zeros((2, 3))})


@for_each_kernel("viscosities.laminar", across=5.0)
def shearing_pair(w):
    """a_1 = -m_2 2 mu/(rho_1 rho_2) |W'(h/2)|/1.01 (4, 2, 5)."""
    drag = 2 * 0.5 / (800 * 1200) * w.slope / 1.01
    return Exact(w.pair, GIVEN, {"acceleration": drag * np.array([[-3.0], [2.0]]) * [4.0, 2.0, 5.0]})
