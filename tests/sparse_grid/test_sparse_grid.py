"""Tables of the sparse grid on a CPU against NumPy's sorting and SciPy's graphs, integer for integer."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from refsim.backends.arrays import Backend
from refsim.sparse_grid import SparseGrid, nodes
from refsim.sparse_grid.reference import node_table
from refsim.surface_energy.components import components

CELL = 0.1
COUNT = 9000  # several chunks


def places(kind, dim, dtype):
    """Positions (n, 3) [m] at random, on the borders of half cells, or one unit in the last place beside these."""
    rng = np.random.default_rng(0)
    position = (CELL * rng.integers(-30, 30, (COUNT, 3)) / 2).astype(dtype)
    if kind == "random":
        position = rng.uniform(-1.5, 1.5, (COUNT, 3)).astype(dtype)
    if kind == "beside":
        position = np.nextafter(position, rng.choice([-9, 9], position.shape).astype(dtype))
    position[:, dim:] = 0
    return position


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("kind", ["random", "borders", "beside"])
@pytest.mark.parametrize("dim", [2, 3])
def test_points_are_sorted_as_by_numpy(dim, kind, dtype):
    grid, position = SparseGrid(Backend("cpu"), dim, dtype, CELL), places(kind, dim, dtype)
    blocks = grid.cover(position, 1, 2)
    table = {tuple(place): number for number, place in enumerate(node_table(blocks).tolist())}
    for shift in (0.0, 0.5):
        j = np.floor(position.astype(float) * grid.programs.inverse_cell - shift).astype(int)
        j[:, dim:] = 0
        expected = np.array([table[tuple(place)] for place in j.tolist()])
        listed = grid.by_cell(position, blocks, shift)
        np.testing.assert_array_equal(listed.cell, expected)
        np.testing.assert_array_equal(listed.point, np.argsort(expected, kind="stable"))
        np.testing.assert_array_equal(np.diff(listed.first), np.bincount(expected, minlength=nodes(blocks)))


@pytest.mark.parametrize("share", [0.3, 0.6, 0.97, 1.0])
@pytest.mark.parametrize("dim", [2, 3])
def test_components_are_those_of_a_graph(dim, share):
    """Nodes inside at random; the blocks of the first half are full."""
    blocks = SparseGrid(Backend("cpu"), dim, "float64", CELL).cover(places("random", dim, "float64")[:300], 1, 2)
    count, place = nodes(blocks), node_table(blocks)
    state = (np.random.default_rng(1).random(count) < share).astype(np.uint8)
    state[: count // 2] = 1
    number = {tuple(at): i for i, at in enumerate(place.tolist())}
    pairs = [
        (i, other)
        for i, at in enumerate(place.tolist())
        for axis in range(dim)
        if (other := number.get(tuple(x + (c == axis) for c, x in enumerate(at)))) is not None
        and state[i] == 1 == state[other]
    ]
    first, second = np.array(pairs).T
    _, part = connected_components(coo_array((np.ones(len(pairs)), (first, second)), shape=(count, count)), False)
    lowest = np.full(part.max() + 1, count)
    np.minimum.at(lowest, part, np.arange(count))
    label = np.empty(count, np.int32)
    components(blocks, state, label)
    np.testing.assert_array_equal(label, np.where(state == 1, lowest[part], -1))
