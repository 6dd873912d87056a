"""Inputs and closed forms of surface normals, and shapes whose surface is everywhere, nowhere or without direction."""

import numpy as np

from refsim.core import cases
from refsim.core.cases import Case, Exact, case, groups, hard_input, lattice, pair_case, particles, takes, vectors
from refsim.smoothing import smoothing
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import liquid_of
from refsim.surface_normal import NormalTerm, axial_part, normal_term, operations
from refsim.surface_normal.operations import SHAPES


@particles("surface_normal", "corrected_normal", "area_normal")
def _normals(case, random):
    """Lengths from zero to well above one, and some exactly zero; of the shapes J(19), walls taken as liquid."""
    if case.name in SHAPES:
        everyone = np.vstack([case.position, case.wall_position])
        one = np.ones(len(everyone))
        kernel = smoothing("wendland_c2", case.support_radius, case.dim)
        term = NormalTerm(1.0, np.int32(0))
        volume = case.spacing**case.dim * one
        normal = operations.color_gradient(everyone, volume, one, None, None, kernel, term)["surface_normal"]
        return normal.value[: case.count]
    values = 0.7 * vectors(case, random)
    values[3::7] = 0
    return values


particles(candidates=lambda case, random: (random.random(case.count) < 0.6).astype(np.uint8))


groups("normal_term", "axial")(
    lambda case, grid: normal_term(liquid_of(case.effects), grid, own_density=case.literal) | axial_part("axial", grid)
)
cases.readings(normal_term="own_density")
takes("surface_normal.color_gradient", normal_term="own_density")


PAIR = pair_case("normal_pair")
TERM = NormalTerm(4.0, 0)


@for_each_kernel("surface_normal.color_gradient")
def pair_normals(w):
    """n_1 = h V_2 W'(r) e_12 points towards particle 2."""
    inputs = {"mass": [2.0, 3.0], "density": [1000.0, 500.0], "normal_term": TERM, "candidates": np.ones(2, np.uint8)}
    return Exact(PAIR, inputs, {"surface_normal": 2 * w.slope * np.array([[0.0, 3 / 500, 0.0], [0.0, -2 / 1000, 0.0]])})


@for_each_kernel("surface_normal.corrected")
def pair_corrected_normals(w):
    """n*_1 = ((d_2 - d_1)/d_0) V_2 W'(r) e_12 / (V_1 W(0) + V_2 W(r)); the second particle is no candidate."""
    volume = np.array([2 / 1000, 3 / 500])
    filled = volume[0] * w.at_zero + volume[1] * w.share * w.at_zero
    inputs = {
        "mass": [2.0, 3.0], "density": [1000.0, 500.0], "number_density": [1.0, 3.0], "normal_term": TERM,
        "candidates": [1, 0],
    }  # fmt: skip
    return Exact(PAIR, inputs, {"corrected_normal": [[0.0, 0.5 * volume[1] * w.slope / filled, 0.0], [0.0, 0.0, 0.0]]})


def tank_corner() -> Case:
    """A block on a floor and against a wall: only its other faces are free."""
    everyone = lattice((9, 9, 5)) - [0.1, 0.1, 0.0]
    wall = (everyone[:, :2] < -1e-9).any(1)
    inside = (everyone[:, :2] < 0.55).all(1)
    return Case("tank_corner", 3, everyone[~wall & inside], wall_position=everyone[wall], **SHAPE)


def jittered_film() -> np.ndarray:
    """A turned sheet in space of two layers, every particle displaced by up to a tenth of the spacing."""
    position = lattice((7, 7, 2))
    position += 0.01 * np.random.default_rng(3).uniform(-1, 1, position.shape)
    return position @ (np.array([[2.0, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3).T


def bent_filament() -> np.ndarray:
    """A row of single particles along a helix in space."""
    angle = np.arange(30) / 5
    return 0.4 * np.stack([np.cos(angle), np.sin(angle), 0.9 * angle], axis=1)


def notch() -> np.ndarray:
    """A V-shaped notch along z with its bottom at the origin: its edges at exactly 45 degrees, a tie of the scan."""
    position = lattice((11, 11, 3)) - [0.5, 0.5, 0.1]
    return position[position[:, 1] <= np.abs(position[:, 0]) + 1e-9]


# Shapes of equal particles, as their free surface is found in use
SHAPE = {"support_radius": 0.26, "masses": (1, 1), "ties": True}
case(tank_corner)
# a sheet in space of two layers: both are surface, and each occupies the scan region of the other
hard_input("two_layers", 3, lambda: lattice((7, 2, 7)), **SHAPE)
# a sheet in the plane of three layers: the normals in the middle vanish
hard_input("three_layers", 2, lambda: lattice((9, 3, 1), dim=2), **SHAPE)
# a block without its middle particle: a void too small to have a surface
hard_input("cavity", 2, lambda: np.delete(lattice((9, 9, 1), dim=2), 40, axis=0), **SHAPE)
hard_input("jittered_film", 3, jittered_film, **SHAPE)
hard_input("bent_filament", 3, bent_filament, **SHAPE)
hard_input("notch", 3, notch, **SHAPE)
