"""Inputs and closed forms of particle shifting."""

import numpy as np

from refsim.core.cases import Exact, at, example, groups
from refsim.particle_shifting import ParticleShifting, Shifting
from refsim.smoothing.cases import for_each_kernel

example(ParticleShifting(), brings="near_surface shift")

PAIR = at("shifted_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


groups(
    # some of the particles would go beyond the longest shift; W(d) is about that of a spacing
    shifting=lambda case, grid: Shifting(*map(grid.real, (0.02 * case.support_radius, case.spacing**case.dim, 0.04))),
)


def moving(case, grid):
    """Largest values of a step with v_max = 3 m/s."""
    return np.array([9.0, 0, 0, 0, 0, 0, 0], dtype=grid.dtype)


def _given(w, **more):
    return {
        "mass": [2.0, 3.0], "density": [1000.0, 500.0], "walls": None, "near_surface": None,
        "surface_normal": None, "extremes": [16.0, 0, 0, 0, 0, 0, 0], "timestep": [0.5, 0.25],
        "shifting": Shifting(0.5, 1 / (w.share * w.own), 1e9),
    } | more  # fmt: skip


STEP = 0.5 * 1.0 * 1.2  # A 2 h_s v_max dt (1 + 0.2), over the volume and |W'(d)|


@for_each_kernel("particle_shifting.shift")
def apart(w):
    """The neighbour stands at W(d): the pair parts by A v_max dt 2 h_s V_j 1.2 |W'|."""
    shift = STEP * w.slope * np.array([[0.0, -3.0 / 500.0, 0.0], [0.0, 2.0 / 1000.0, 0.0]])
    return Exact(PAIR, _given(w), {"shift": shift})


@for_each_kernel("particle_shifting.shift")
def along_the_surface(w):
    """Near the surface only the part across the normal is left, and nothing where the normal has no direction."""
    normal = np.array([[3.0, 4.0, 0.0], [0.0, 0.01, 0.0]])
    along = STEP * w.slope * -3.0 / 500.0 * np.array([-0.48, 0.36, 0.0])  # (0, 1) less (0, 1).n n, n = (0.6, 0.8)
    near = np.array([1, 1], np.uint8)
    return Exact(PAIR, _given(w, near_surface=near, surface_normal=normal), {"shift": [along, np.zeros(3)]})


@for_each_kernel("particle_shifting.shift")
def no_further(w):
    """Bounded by half of what the first would move, over v_max dt = 1 m; the second moves by a third."""
    bound = 0.5 * STEP * w.slope * 3.0 / 500.0
    shift = np.array([[0.0, -bound, 0.0], [0.0, STEP * w.slope * 2.0 / 1000.0, 0.0]])
    return Exact(PAIR, _given(w, shifting=Shifting(0.5, 1 / (w.share * w.own), bound)), {"shift": shift})
