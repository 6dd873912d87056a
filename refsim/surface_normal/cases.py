"""Inputs and closed forms of surface normals."""

import math

import numpy as np

from refsim.cases import Case, Exact, closed_form, groups, particles, vectors
from refsim.surface_normal import NormalTerm, normal_term


@particles("surface_normal", "corrected_normal", "area_normal")
def _normals(case, random):
    """Lengths from zero to well beyond one, and some exactly zero."""
    values = 0.7 * vectors(case, random)
    values[3::7] = 0
    return values


@particles("candidates")
def _candidates(case, random):
    return (random.random(case.count) < 0.6).astype(np.uint8)


@groups("normal_term")
def _normal_term(case, grid):
    return normal_term(case.effects["weakly_compressible"], grid, own_density=case.literal)


# h = 2 m: in 3D Wendland W(0) = 21/(16 pi), W(h/2) = 3/16 W(0), W'(h/2) = -5/8 W(0) per metre.
W0 = 21 / (16 * math.pi)
SLOPE = -5 / 8 * W0
PAIR = Case("normal_pair", 3, np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), spacing=1.0, support_radius=2.0)
TERM = NormalTerm(4.0, np.int32(0))


@closed_form("surface_normal.color_gradient")
def pair_normals():
    """n_1 = h V_2 W'(r) e_12 points towards particle 2."""
    return Exact(
        PAIR,
        {"mass": np.array([2.0, 3.0]), "density": np.array([1000.0, 500.0]), "normal_term": TERM,
         "candidates": np.ones(2, np.uint8)},
        {"surface_normal": 2 * -SLOPE * np.array([[0.0, 3 / 500, 0.0], [0.0, -2 / 1000, 0.0]])},
    )  # fmt: skip


@closed_form("surface_normal.corrected")
def pair_corrected_normals():
    """n*_1 = ((d_2 - d_1)/d_0) V_2 W'(r) e_12 / (V_1 W(0) + V_2 W(r)); the second has no turn as a candidate."""
    volume = np.array([2 / 1000, 3 / 500])
    filled = volume[0] * W0 + volume[1] * 3 / 16 * W0
    return Exact(
        PAIR,
        {"mass": np.array([2.0, 3.0]), "density": np.array([1000.0, 500.0]), "number_density": np.array([1.0, 3.0]),
         "normal_term": TERM, "candidates": np.array([1, 0], np.uint8)},
        {"corrected_normal": np.array([[0.0, 0.5 * volume[1] * -SLOPE / filled, 0.0], [0.0, 0.0, 0.0]])},
    )  # fmt: skip
