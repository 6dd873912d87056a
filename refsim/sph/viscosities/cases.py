"""Inputs and closed forms of the viscous forces."""

import math

import numpy as np

from refsim.core.cases import Exact, closed_form, groups, pair_case
from refsim.sph.viscosities import ArtificialViscosity, LaminarViscosity


@groups("artificial_viscosity", "laminar_viscosity")
def _viscosities(case, grid):
    """c = 20 m/s, and smoothing lengths of half the support radius."""
    h = 0.5 * grid.support_radius
    return {
        "artificial_viscosity": ArtificialViscosity(*map(grid.real, (0.3, 2.0, 20.0, h))),
        "laminar_viscosity": LaminarViscosity(*map(grid.real, (0.5, h))),
    }


# Two particles 1 m apart along y, h = 2 m: |W'(h/2)| of Wendland C2. They approach at 2 m/s.
SLOPE = 5 / 8 * 21 / (16 * math.pi)
GIVEN = {
    "mass": np.array([2.0, 3.0]),
    "density": np.array([800.0, 1200.0]),
    "velocity": np.array([[7.0, 2.0, 0.0], [3.0, 0.0, -5.0]]),
    "artificial_viscosity": ArtificialViscosity(0.5, 2.0, 10.0, 1.0),
    "laminar_viscosity": LaminarViscosity(0.5, 1.0),
}


@closed_form("viscosities.artificial", across=5.0)
def approaching_pair():
    """mu = -2/1.01, Pi = (2 mu^2 - 5 mu)/1000: a_1 = -m_2 Pi |W'| along y."""
    mu = -2 / 1.01
    push = (2 * mu**2 - 5 * mu) / 1000 * SLOPE
    return Exact(pair_case("approaching"), GIVEN, {"acceleration": push * np.array([[0, -3.0, 0], [0, 2.0, 0]])})


@closed_form("viscosities.artificial")
def parting_pair():
    """None."""
    given = GIVEN | {"velocity": -GIVEN["velocity"]}
    return Exact(pair_case("parting"), given, {"acceleration": np.zeros((2, 3))})


@closed_form("viscosities.laminar", across=5.0)
def shearing_pair():
    """a_1 = -m_2 2 mu/(rho_1 rho_2) |W'|/1.01 (4, 2, 5)."""
    drag = 2 * 0.5 / (800 * 1200) * SLOPE / 1.01
    expected = drag * np.array([[-3.0], [2.0]]) * [4.0, 2.0, 5.0]
    return Exact(pair_case("shearing"), GIVEN, {"acceleration": expected})
