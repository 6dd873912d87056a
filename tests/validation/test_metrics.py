"""The yardsticks themselves, held against answers that can be worked out by hand or by another program."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface


def grid(*sites):
    """Lattice of unit spacing, (n, dim)."""
    return np.stack(np.meshgrid(*[np.arange(float(n)) for n in sites], indexing="ij"), axis=-1).reshape(-1, len(sites))


def rim(*sites):
    """Which sites of ``grid`` lie on its outside."""
    point = grid(*sites)
    return ((point == 0) | (point == np.array(sites) - 1)).any(axis=1)


COVER = {2: arc_cover_surface, 3: cap_cover_surface}


@pytest.mark.parametrize("dim", [2, 3])
def test_coincident_particles_are_one(dim):
    twin = np.zeros((2, dim))
    assert COVER[dim](twin, 1.0).all()
    assert COVER[dim](twin + [[0.0] * dim, [1e-12] * dim], 1.0).all()
    row = np.zeros((3, dim))
    row[:, 0] = -1e-12, 0.0, 1e-12
    assert COVER[dim](row, 1.0).all()
    block = grid(*(5,) * dim)
    double = np.vstack((block, block, block[:3]))
    expected = np.tile(rim(*(5,) * dim), 2)
    assert np.array_equal(COVER[dim](double, 1.2)[: 2 * len(block)], expected)
    one_sided = np.zeros((3, dim))
    one_sided[1:, 0] = 1.0  # equal caps: neither may hide the other's boundary
    assert COVER[dim](one_sided, 1.0).all()
    one_sided[2, 0] += 1e-8
    assert COVER[dim](one_sided, 1.0)[0]


@pytest.mark.parametrize("dim", [2, 3])
def test_walls_cover_but_are_not_judged(dim):
    block = grid(*(6,) * dim)
    outside = grid(*(8,) * dim)[rim(*(8,) * dim)] - 1
    assert not COVER[dim](block, 1.2, outside).any()
    tank = outside[outside[:, -1] < 6]  # open at the top
    assert np.array_equal(COVER[dim](block, 1.2, tank), block[:, -1] == 5)
    assert COVER[dim](block[:1], 1.2, tank[:1]).tolist() == [True]


def test_neighbour_search_is_completed_in_dense_clumps():
    """More neighbours than one search returns: what decides must not be the number looked at."""
    rng = np.random.default_rng(8)
    for dim in (2, 3):
        clump = rng.normal(0, 1e-3, (150, dim))
        answer = COVER[dim](clump, 1.0)
        # R is a thousand times the clump's size, so the probe is all but flat: the convex hull
        assert np.array_equal(np.flatnonzero(answer), np.sort(ConvexHull(clump).vertices))
