"""Isosurfaces on the sparse grid: closed, oriented, of the right shape; scikit-image as a judge from outside."""

import collections
import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree
from skimage import measure

from refsim.backends.arrays import Backend
from refsim.core.errors import InputError
from refsim.isosurface import case_table, extract
from refsim.isosurface.reference import cell_facets, polygons
from refsim.isosurface.table import facets, loops

CPU = Backend("cpu")


def box(half):
    """All nodes from -half to half."""
    return np.array([j[::-1] for j in itertools.product(range(-half, half + 1), repeat=3)])


def ball(x):
    return np.linalg.norm(x, axis=1) - 1


def noise(x):
    """Values of either sign inside a box, outside of it positive: every state of a cell is there."""
    random = np.random.default_rng(3).normal(size=len(x))
    return np.where((abs(x) < 0.65).all(1), random, 1.0)


def meshed(function, half, h, **options):
    nodes = box(half)
    return extract(CPU, nodes, function(h * nodes), h, 3, **options)


def closed(mesh):
    """Every edge in two triangles, once in each direction."""
    found = collections.Counter((int(t[k - 1]), int(t[k])) for t in mesh.facets for k in range(3))
    return set(found.values()) == {1} and all((b, a) in found for a, b in found)


def area(mesh):
    a, b, c = (mesh.vertices[mesh.facets[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()


def test_table_is_what_the_reference_finds_and_the_classical_one_leaves_holes():
    whole = meshed(noise, 8, 0.1)
    merged = meshed(noise, 8, 0.1, merged=True)
    assert closed(whole)
    assert not closed(merged)
    assert np.array_equal(whole.vertices, merged.vertices)
    for dim in (2, 3):
        table = case_table(dim)
        for state in range(2 ** (2**dim)):
            assert facets(state, dim) == cell_facets(state, dim), state
            assert sorted(map(sorted, loops(state, dim))) == sorted(map(sorted, polygons(state, dim)))
            own = table.edge[state][: dim * table.count[state]].reshape(-1, dim)
            assert [tuple(row) for row in own] == facets(state, dim)
    assert case_table(3).count.max() == 5
    turned = {tuple(sorted(facets(s, 3))) != tuple(sorted(f[::-1] for f in facets(255 - s, 3))) for s in range(256)}
    assert turned == {True, False}  # complements are not always the same surface turned round


@pytest.mark.parametrize("function", [ball, noise], ids=["ball", "noise"])
def test_vertices_are_those_of_scikit_image(function):
    """The library's own marching cubes as an independent judge: the same points, the same surface up to diagonals."""
    half, h = 10, 0.12
    values = function(h * box(half)).reshape(2 * half + 1, 2 * half + 1, 2 * half + 1)
    vertices, faces, _, _ = measure.marching_cubes(values, 0.0, method="lorensen", allow_degenerate=True)
    mesh = meshed(function, half, h)
    theirs = h * (vertices[:, ::-1] - half)
    for ours, other in ((mesh.vertices, theirs), (theirs, mesh.vertices)):
        assert cKDTree(other).query(ours)[0].max() < 1e-6
    if function is ball:
        assert len(faces) == len(mesh.facets)
        assert area(mesh) == pytest.approx(h**2 * measure.mesh_surface_area(vertices, faces), rel=1e-3)


@pytest.mark.parametrize("values", [np.zeros(0), np.ones(5)], ids=["no nodes", "all outside"])
def test_nothing_inside_gives_an_empty_mesh(values):
    mesh = extract(CPU, box(2)[: len(values)], values, 0.1, 3)
    assert (mesh.vertices.shape, mesh.facets.shape) == ((0, 3), (0, 3))


@pytest.mark.parametrize(("coordinates", "values", "h", "words"), [
    (np.zeros((2, 3), int), np.zeros(2), 0.1, "given twice"), (np.zeros((2, 2), int), np.zeros(2), 0.1, "do not fit"),
    (box(1), np.zeros(27, int), 0.1, "do not fit"), (box(1), np.zeros(27), 0.0, "cell_size = 0.0"),
])  # fmt: skip
def test_bad_input_is_told(coordinates, values, h, words):
    with pytest.raises(InputError, match=words):
        extract(CPU, coordinates, values, h, 3)
