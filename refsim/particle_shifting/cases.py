"""Inputs and closed forms of particle shifting."""

import math

import numpy as np

from refsim.core.cases import Case, Exact, closed_form, example, groups
from refsim.particle_shifting import ParticleShifting, Shifting

example(ParticleShifting(), brings="near_surface shift")

W0 = 21 / (16 * math.pi)  # W(0) of Wendland C2, h = 2 m; W(h/2) = 3/16 W(0), |W'(h/2)| = 5/8 W(0)
PAIR = Case("shifted_pair", 3, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), spacing=1.0, support_radius=2.0)


@groups("shifting")
def _shifting(case, grid):
    """Some of the particles would go beyond the longest shift; W(d) is about that of a spacing."""
    return {"shifting": Shifting(*map(grid.real, (0.02 * case.support_radius, case.spacing**case.dim, 0.04)))}


def moving(case, grid):
    """Largest values of a step with v_max = 3 m/s."""
    return np.array([9.0, 0, 0, 0, 0, 0, 0], dtype=grid.dtype)


def _given(**more):
    return {
        "mass": np.array([2.0, 3.0]), "density": np.array([1000.0, 500.0]), "walls": None, "near_surface": None,
        "surface_normal": None, "extremes": np.array([16.0, 0, 0, 0, 0, 0, 0]), "timestep": np.array([0.5, 0.25]),
        "shifting": Shifting(0.5, 16 / (3 * W0), 1e9),
    } | more  # fmt: skip


STEP = 0.5 * 1.0 * 1.2 * 5 / 8 * W0  # A 2 h_s v_max dt (1 + 0.2) |W'(d)|, over the volume


@closed_form("particle_shifting.shift")
def apart():
    """The neighbour stands at W(d): the pair parts by A v_max dt 2 h_s V_j 1.2 |W'|."""
    shift = STEP * np.array([[0.0, -3.0 / 500.0, 0.0], [0.0, 2.0 / 1000.0, 0.0]])
    return Exact(PAIR, _given(), {"shift": shift})


@closed_form("particle_shifting.shift")
def along_the_surface():
    """Near the surface only the part across the normal is left, and nothing where the normal has no direction."""
    normal = np.array([[3.0, 4.0, 0.0], [0.0, 0.01, 0.0]])
    along = STEP * -3.0 / 500.0 * np.array([-0.48, 0.36, 0.0])  # (0, 1) less (0, 1).n n, n = (0.6, 0.8)
    near = np.array([1, 1], np.uint8)
    return Exact(PAIR, _given(near_surface=near, surface_normal=normal), {"shift": np.array([along, np.zeros(3)])})


@closed_form("particle_shifting.shift")
def no_further():
    """Bounded by 0.0005 v_max dt = 0.0005 m."""
    shift = np.array([[0.0, -0.0005, 0.0], [0.0, STEP * 2.0 / 1000.0, 0.0]])
    assert STEP * 2.0 / 1000.0 < 0.0005 < STEP * 3.0 / 500.0
    return Exact(PAIR, _given(shifting=Shifting(0.5, 16 / (3 * W0), 0.0005)), {"shift": shift})
