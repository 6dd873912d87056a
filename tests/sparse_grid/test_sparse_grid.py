"""Tables of the sparse grid on a CPU against NumPy's sorting and SciPy's graphs, integer for integer."""

import numpy as np
import pytest

from refsim.backends.arrays import Backend
from refsim.sparse_grid import SparseGrid, nodes
from refsim.sparse_grid.reference import node_table

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
