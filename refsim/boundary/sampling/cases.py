"""Inputs and closed forms of boundary sampling: bodies around a case's particles, and the particles themselves."""

import math

import numpy as np

from refsim.boundary.sampling import CUTOFF, HEXAGONAL, STEP, WIDTH, facet_counts, operations, relaxation_step
from refsim.boundary.signed_distance.cases import SHAPES, bodies
from refsim.core.cases import CASES, Case, Exact, closed_form, groups, hard_input, readings


@groups("facet_corner", "facets_of_mesh", "facet_area", "facet_last", "sample_seed", "placed")
def _facets(case, grid):
    mesh = SHAPES[case.name]() if case.name in SHAPES else bodies(case)
    corner, facets = mesh.vertices.astype(grid.dtype), mesh.faces.astype(np.int32)
    area = operations.areas(corner, facets)["facet_area"][0]
    last = facet_counts(area, HEXAGONAL, 0.1 * case.spacing)
    count = int(last[-1]) if len(last) else 0
    return {
        "facet_corner": corner, "facets_of_mesh": facets, "facet_area": area.astype(grid.dtype), "facet_last": last,
        "sample_seed": np.int64(3), "placed": np.zeros((count, 3), grid.dtype),
    }  # fmt: skip


groups(relaxation=lambda case, grid: relaxation_step(case.list_radius / 2.4, 0.5, 5, False, grid.dtype))


def as_printed(case, grid):
    """The step as printed (patent E24)."""
    return relaxation_step(case.list_radius / (CUTOFF * WIDTH), STEP, 5, True, grid.dtype)


readings(relaxation="tangential")

# groups of two, three and seven coincident particles, on the surface of the first body
PILES = 0.045 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0.5, 0.5, 0]])
hard_input("piled_up", 3, lambda: np.repeat(PILES, (1, 2, 3, 7, 1), axis=0))


@closed_form("sampling.areas")
def half_squares():
    """Half of a unit square, half of a square of side 2 m, and a triangle without area."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [0, 0, 2]], float)
    facets = np.array([[0, 1, 2], [0, 3, 4], [0, 1, 3]], np.int32)
    inputs = {"facet_corner": corner, "facets_of_mesh": facets}
    return Exact(Case("half_squares", 3, np.zeros((1, 3))), inputs, {"facet_area": [0.5, 2.0, 0.0]})


@closed_form("sampling.place")
def at_points():
    """Facets that are points; the second gets two particles and the third none."""
    corner = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9], [-1, 0, 1]], float)
    facets = np.repeat(np.arange(4, dtype=np.int32)[:, None], 3, axis=1)
    last = np.array([1, 3, 3, 4], np.int32)
    inputs = {"facet_corner": corner, "facets_of_mesh": facets, "facet_last": last}
    return Exact(Case("at_points", 3, np.zeros((1, 3))), inputs, {"placed": corner[[0, 1, 1, 3]]})


@closed_form("sampling.relax")
def a_pair_over_a_cube():
    """Two particles 0.4 m apart, 0.3 m above the cube's upper face, sigma = 0.4 m, r = 0.5 m, lambda = 0.4.

    Omega = exp(-1/2), so each moves 0.2 exp(-1/2) m along the face and 0.3 m down onto it.
    """
    inputs = {"relaxation": relaxation_step(0.5, 0.4, 1, False, "float64")}
    apart = 0.2 * math.exp(-0.5)
    where = np.array([[0.1 - apart, 0.1, 1.0], [0.5 + apart, 0.1, 1.0]])
    case = CASES["unit_cube"]()
    pair = Case("unit_cube", 3, np.array([[0.1, 0.1, 1.3], [0.5, 0.1, 1.3]]), spacing=case.spacing, support_radius=2.0)
    return Exact(pair, inputs, {"relaxed_position": where, "step_length": np.full(2, math.hypot(apart, 0.3))})
