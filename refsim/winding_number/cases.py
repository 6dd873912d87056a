"""Inputs and closed forms of the winding number: small bodies around a case's particles, and bodies that overlap."""

import numpy as np

from refsim.core.cases import VARIATIONS, Exact, Variation, at, closed_form, groups, hard_input
from refsim.winding_number import Clusters, clusters

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
FACES = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]], np.int64)
BODIES = 8  # around the first particles of a case
VIEWPOINTS = 24


def octahedra(middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Triangles (8 n, 3, 3) [m] of octahedra around points (n, 3) [m]."""
    return (middle[:, None, None] + radius[:, None, None, None] * OCTAHEDRON[FACES]).reshape(-1, 3, 3)


# Octahedra far apart, so that each is a cluster of its own for the others; two of them overlap
MIDDLES = [[0, 0, 0], [0.05, 0.02, 0.01], [7, 0, 0], [0, 9, 0], [-8, 0, 3], [0, 0, 11], [5, 5, 5], [-4, -6, 2]]
hard_input("wound_bodies", 3, lambda: MIDDLES, spacing=0.4, support_radius=0.8)


@groups("clusters", "viewpoint", "winding_number")
def _winding(case, grid):
    random = case.random("viewpoint")
    middle = case.position[:BODIES]
    middle = middle - (middle[:1] if len(middle) else 0)
    triangles = octahedra(middle, 0.37 * case.spacing * np.ones(len(middle)))
    near = middle[random.integers(0, len(middle), VIEWPOINTS)] if len(middle) else np.zeros((0, 3))
    points = (near + case.spacing * random.normal(size=near.shape)).astype(grid.dtype)
    return {
        "clusters": clusters(triangles, grid.dtype), "viewpoint": points,
        "winding_number": np.zeros(len(points), grid.dtype),
    }  # fmt: skip


VARIATIONS[Clusters] = Variation(held={"first": "offsets of the rows of `corner`"})


def _exact(name: str, triangles: np.ndarray, points: list, wanted: list) -> Exact:
    inputs = {"clusters": clusters(triangles, "float64"), "viewpoint": np.array(points, float)}
    return Exact(at(name, [0, 0, 0]), inputs, {"winding_number": wanted})


@closed_form("winding_number.winding")
def nested_octahedra():
    """Two octahedra, 1 m and 3 m: 2 within both, 1 between them, 0 outside."""
    points = [[0.1, 0.2, 0.05], [1.1, 0.5, 0.2], [2.0, 2.0, 2.0]]
    return _exact("nested", octahedra(np.zeros((2, 3)), np.array([1.0, 3.0])), points, [2.0, 1.0, 0.0])


@closed_form("winding_number.winding")
def an_open_octant():
    """One face of an octahedron about its centre: an eighth of the sphere."""
    face = OCTAHEDRON[FACES[:1]]
    return _exact("octant", face, [[0, 0, 0]], [0.125])


@closed_form("winding_number.winding")
def a_far_dipole():
    """A triangle of area 1/2 m^2, 4 m off the origin, seen from 100 m along its normal: N.d/(4 pi d^3)."""
    triangle = np.array([[[4, 0, 0], [5, 0, 0], [4, 1, 0]]], float)
    return _exact(
        "dipole", triangle, [[13 / 3, 1 / 3, -100.0], [13 / 3, 1 / 3, 100.0]],
        [0.5 / (4 * np.pi * 1e4), -0.5 / (4 * np.pi * 1e4)],
    )  # fmt: skip
