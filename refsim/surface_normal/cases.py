"""Inputs and closed forms of surface normals, and shapes whose surface is everywhere, nowhere or without direction."""

import numpy as np

from refsim.core.cases import Case, Exact, case, groups, lattice, pair_case, particles, takes, vectors
from refsim.smoothing import smoothing
from refsim.smoothing.cases import for_each_kernel
from refsim.sph import liquid_of
from refsim.surface_normal import NormalTerm, normal_term, reference
from refsim.surface_normal.reference import SHAPES


@particles("surface_normal", "corrected_normal", "area_normal")
def _normals(case, random):
    """Lengths from zero to well above one, and some exactly zero; of the shapes J(19), walls taken as liquid."""
    if case.name in SHAPES:
        everyone = np.vstack([case.position, case.wall_position])
        one = np.ones(len(everyone))
        kernel = smoothing("wendland_c2", case.support_radius, case.dim)
        term = NormalTerm(1.0, np.int32(0))
        volume = case.spacing**case.dim * one
        return reference.color_gradient(everyone, volume, one, None, None, kernel, term)["surface_normal"][0][
            : case.count
        ]
    values = 0.7 * vectors(case, random)
    values[3::7] = 0
    return values


@particles("candidates")
def _candidates(case, random):
    return (random.random(case.count) < 0.6).astype(np.uint8)


@groups("normal_term")
def _normal_term(case, grid):
    return normal_term(liquid_of(case.effects), grid, own_density=case.literal)


takes("surface_normal.color_gradient", normal_term="own_density")


PAIR = pair_case("normal_pair")
TERM = NormalTerm(4.0, np.int32(0))


@for_each_kernel("surface_normal.color_gradient")
def pair_normals(w):
    """n_1 = h V_2 W'(r) e_12 points towards particle 2."""
    return Exact(
        PAIR,
        {"mass": np.array([2.0, 3.0]), "density": np.array([1000.0, 500.0]), "normal_term": TERM,
         "candidates": np.ones(2, np.uint8)},
        {"surface_normal": 2 * w.slope * np.array([[0.0, 3 / 500, 0.0], [0.0, -2 / 1000, 0.0]])},
    )  # fmt: skip


@for_each_kernel("surface_normal.corrected")
def pair_corrected_normals(w):
    """n*_1 = ((d_2 - d_1)/d_0) V_2 W'(r) e_12 / (V_1 W(0) + V_2 W(r)); the second particle is no candidate."""
    volume = np.array([2 / 1000, 3 / 500])
    filled = volume[0] * w.own + volume[1] * w.share * w.own
    return Exact(
        PAIR,
        {"mass": np.array([2.0, 3.0]), "density": np.array([1000.0, 500.0]), "number_density": np.array([1.0, 3.0]),
         "normal_term": TERM, "candidates": np.array([1, 0], np.uint8)},
        {"corrected_normal": np.array([[0.0, 0.5 * volume[1] * w.slope / filled, 0.0], [0.0, 0.0, 0.0]])},
    )  # fmt: skip


def shape(name: str, dim: int, position: np.ndarray, **options) -> Case:
    """A shape of equal particles, as its free surface is found in use."""
    return Case(name, dim, position, support_radius=0.26, masses=(1, 1), ties=True, **options)


@case
def two_layers() -> Case:
    """A sheet in space of two layers: both are surface, and each occupies the scan region of the other."""
    return shape("two_layers", 3, lattice((7, 2, 7)))


@case
def three_layers() -> Case:
    """A sheet in the plane of three layers: the normals in the middle vanish."""
    return shape("three_layers", 2, lattice((9, 3, 1), dim=2))


@case
def cavity() -> Case:
    """A block without its middle particle: a void too small to have a surface."""
    position = lattice((9, 9, 1), dim=2)
    return shape("cavity", 2, np.delete(position, len(position) // 2, axis=0))


@case
def tank_corner() -> Case:
    """A block on a floor and against a wall: only its other faces are free."""
    everyone = lattice((9, 9, 5)) - [0.1, 0.1, 0.0]
    wall = (everyone[:, :2] < -1e-9).any(1)
    inside = (everyone[:, :2] < 0.55).all(1)
    return shape("tank_corner", 3, everyone[~wall & inside], wall_position=everyone[wall])


@case
def jittered_film() -> Case:
    """A turned sheet in space of two layers, every particle displaced by up to a tenth of the spacing."""
    position = lattice((7, 7, 2))
    position += 0.01 * np.random.default_rng(3).uniform(-1, 1, position.shape)
    turn = np.array([[2.0, -1, 2], [2, 2, -1], [-1, 2, 2]]) / 3
    return shape("jittered_film", 3, position @ turn.T)


@case
def bent_filament() -> Case:
    """A row of single particles along a helix in space."""
    angle = np.arange(30) / 5
    return shape("bent_filament", 3, 0.4 * np.stack([np.cos(angle), np.sin(angle), 0.9 * angle], axis=1))


@case
def notch() -> Case:
    """A V-shaped notch along z with its bottom at the origin: its edges at exactly 45 degrees, a tie of the scan."""
    position = lattice((11, 11, 3)) - [0.5, 0.5, 0.1]
    return shape("notch", 3, position[position[:, 1] <= np.abs(position[:, 0]) + 1e-9])
