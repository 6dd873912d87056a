"""Inputs and closed forms of particle shifting."""

import numpy as np

from refsim.core.cases import Exact, at, closed_form, example, groups, particles, plain_keeps, takes
from refsim.core.walls import WallParticles
from refsim.particle_shifting import ParticleShifting, Shifting
from refsim.smoothing import smoothing
from refsim.smoothing.cases import for_each_kernel

example(ParticleShifting(), brings="way number_density longest_shift velocity_range")

takes("particle_shifting.crowding", shifting="length inverse_neighbour largest least whole outer within")
takes("particle_shifting.longest_shift", shifting="farthest")
plain_keeps("particle_shifting.velocity_range", drawn_body="the output has a row for each body")
PAIR = at("shifted_pair", [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


groups(
    # some of the particles would go beyond the longest shift, and all in the plane; W(d) is about that of a spacing
    shifting=lambda case, grid: Shifting(
        *map(grid.real, (0.02 * case.support_radius, case.spacing**case.dim, 0.04)),
        *map(grid.real, (1 / case.support_radius, 1.02, 0.9, 0.95, 1e-3 if case.dim == 2 else 1e9)),
    )
)


@particles("way")
def _ways(case, random):
    """Those of a lattice and of a surface."""
    return random.normal(0, 0.2, (case.count, 3))


@particles("filling")
def _filling(case, random):
    """Of a surface and of a lattice."""
    return random.uniform(0.6, 1.1, case.count)


# v_max = 3 m/s: half of the diagonal of a box of 4 m/s, 2 m/s and 4 m/s; 1.5 m/s of another body
RANGE = np.array([[1.0, 0.5, 1.25, 3, 1.5, 2.75], [2.0, -1.0, 5.0, 0.0, 2.0, -3.0]])
groups(velocity_range=lambda case, grid: RANGE[: 1 + (case.count > 1)].astype(grid.dtype))
groups(
    longest_shift=lambda case, grid: (
        0.01 * case.spacing * np.array([1.0, 0.4])[: 1 + (case.count > 1)].astype(grid.dtype)
    )
)
particles("drawn_body")(lambda case, random: np.arange(case.count, dtype=np.int32) % 2)
GIVEN = {
    "volume": [2.0, 3.0], "density": [1000.0, 500.0], "walls": None, "filling": None, "phase": None,
    "velocity_range": [[1.0, 8.0, 0.0, 5.0, 0.0, 0.0]], "timestep": [0.5, 0.2], "drawn_body": None,
}  # fmt: skip


@for_each_kernel("particle_shifting.crowding")
def apart(w):
    """The neighbour stands at W(d): -A 2 h_s sum_j V_j 1.2 W' e_ij."""
    way = 0.5 * 1.2 * w.slope * np.array([[0.0, -3.0 / 500.0, 0.0], [0.0, 2.0 / 1000.0, 0.0]])
    return Exact(PAIR, GIVEN | {"shifting": Shifting(0.5, 1 / (w.share * w.at_zero), 1e9)}, {"way": way})


SLOW = 3 * (1 + 0.2 * (8 / 27) ** 4)


def _beside_walls(way, filling, shifting=(1e9, 0.05), **given):
    """A particle between wall particles at h/2 along x and h/4 along y, of which W(h/4) = 27/8 W(h/2) is W(d).

    Their volumes make the gradient of the filling (3, 4, 0), so that of the concentration is (SLOW, 4.8, 0).
    """
    case = at("beside_walls", [0, 0, 0], np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0]]))
    scale = 21 / (2 * np.pi * 8)  # of Wendland's C2 with h = 2 m
    walls = WallParticles(case.wall_position, np.array([3.0, 4.0]) / (scale * np.array([0.625, 1.0546875])))
    given = {"walls": walls, "shifting": Shifting(0.5, 128 / (scale * 81), *shifting)} | given
    particle = {"volume": [1.0], "density": None, "filling": [filling], "smoothing": smoothing("wendland_c2", 2.0, 3)}
    return Exact(case, GIVEN | particle | given, {"way": [way]})


def _left(along, across):
    """-A 2 h_s of these shares of n = (3, 4, 0) and of the part along n of e = g - n, and of the rest of e."""
    n, e = np.array([3.0, 4.0, 0.0]), np.array([SLOW - 3, 0.8, 0.0])
    return -0.5 * (along * n + e + (across - 1) * (e @ n) / 25 * n)


closed_form(
    "particle_shifting.crowding",
    along_the_surface=lambda: _beside_walls(_left(0.0, 0.0), 0.9),
    near_the_surface=lambda: _beside_walls(_left(0.0, 0.5), 0.925),
    between_surface_and_inside=lambda: _beside_walls(_left(0.5, 1.0), 0.985),
    inside=lambda: _beside_walls(_left(1.0, 1.0), 1.25),
    without_direction=lambda: _beside_walls([0.0, 0.0, 0.0], 0.9, (1e9, 5.5)),
    solid=lambda: _beside_walls([0.0, 0.0, 0.0], 1.25, phase=[1]),
    bounded=lambda: _beside_walls(0.3 * _left(1.0, 1.0) / np.linalg.norm(_left(1.0, 1.0)), 1.25, (0.3, 0.05)),
)


@closed_form("particle_shifting.velocity_range")
def of_two_bodies():
    """Each particle alone."""
    inputs = {"velocity": [[100.0, 0.0, 50.0], [96.0, 3.0, -45.0]], "drawn_body": np.array([0, 1], np.int32)}
    return Exact(PAIR, inputs, {"velocity_range": [[100.0, 0.0, 50.0, -100.0, 0.0, -50.0], [96, 3, -45, -96, -3, 45]]})


@closed_form("particle_shifting.velocity_range")
def of_one_body():
    """Largest and smallest velocities of both."""
    inputs = {"velocity": [[100.0, 0.0, 50.0], [96.0, 3.0, -45.0]], "drawn_body": None}
    return Exact(PAIR, inputs, {"velocity_range": [[100.0, 3.0, 50.0, -96.0, 0.0, 45.0]]})


WAYS = np.array([[0.0, -0.3, 0.0], [0.1, 0.0, 0.25]])
closed_form(  # v_max = sqrt(6^2 + 8^2)/2 m/s, for 0.2 s: 1 m, which may count as 0.4 m
    "particle_shifting.longest_shift",
    as_fast=lambda: Exact(PAIR, GIVEN | {"shifting": Shifting(0.5, 1.0, 0.3)}, {"longest_shift": [1.0]}),
    where_it_would_overshoot=lambda: Exact(
        PAIR, GIVEN | {"shifting": Shifting(0.5, 1.0, 0.3, farthest=0.4)}, {"longest_shift": [0.4]}
    ),
)
closed_form(
    "particle_shifting.shift",
    of_one_body=lambda: Exact(PAIR, GIVEN | {"way": WAYS, "longest_shift": [0.4]}, {"shift": 0.4 * WAYS}),
)
