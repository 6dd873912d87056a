"""The yardsticks themselves, held against answers that can be worked out by hand or by another program."""

from itertools import combinations

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


# Surface truth
def brute_force_2d(point, radius):
    """On a circle, the farthest from all discs is reached next to a crossing with another circle: try them all."""
    answer = []
    for i, x in enumerate(point):
        other = np.delete(point, i, axis=0)
        trial = [x + (radius, 0.0)]
        for y in other:
            gap = np.linalg.norm(y - x)
            if gap < 2 * radius:
                angle = np.arctan2(*(y - x)[::-1]) + np.arccos(gap / (2 * radius)) * np.array([-1 - 1e-9, 1 + 1e-9])
                trial += list(x + radius * np.stack((np.cos(angle), np.sin(angle)), axis=1))
        gaps = np.linalg.norm(np.array(trial)[:, None] - other, axis=2).min(axis=1)
        answer.append(bool((gaps >= radius).any()))
    return np.array(answer)


def brute_force_3d(point, radius):
    """A sphere is bare iff a crossing of two cap circles is bare, or a circle without crossings, or all of it."""
    answer = []
    for i, x in enumerate(point):
        other = np.delete(point, i, axis=0) - x
        near = other[np.linalg.norm(other, axis=1) < 2 * radius]
        trial = []
        for y in near:  # one point of every circle
            side = np.cross(y, np.eye(3)[np.argmin(np.abs(y))])
            trial.append(y / 2 + side / np.linalg.norm(side) * np.sqrt(radius**2 - y @ y / 4))
        pair = np.array(list(combinations(near, 2))).reshape(-1, 2, 3)  # u.y = |y|^2 / 2, u.z = |z|^2 / 2, |u| = R
        base = (np.linalg.solve(pair @ pair.swapaxes(1, 2), (pair**2).sum(2)[..., None] / 2) * pair).sum(1)
        rest = radius**2 - (base**2).sum(1)
        normal = np.cross(pair[:, 0], pair[:, 1])[rest > 0]
        base, rest = base[rest > 0], rest[rest > 0]
        out = normal * (np.sqrt(rest) / np.linalg.norm(normal, axis=1))[:, None]
        trial = np.concatenate([np.reshape(trial, (-1, 3)), base + out, base - out])
        gaps = np.linalg.norm(near - trial[:, None], axis=2).min(axis=1, initial=np.inf)
        answer.append(len(near) == 0 or bool((gaps >= radius - 1e-9).any()))
    return np.array(answer)


@pytest.mark.parametrize("count", [20, 40, 60])
def test_covers_agree_with_brute_force_on_random_clouds(count):
    rng = np.random.default_rng(count)
    for _ in range(4):
        cloud = rng.random((count, 2)) * 5
        expected = brute_force_2d(cloud, 1.0)
        assert np.array_equal(arc_cover_surface(cloud, 1.0), expected)
    cloud = rng.random((count, 3)) * 2.5
    expected = brute_force_3d(cloud, 1.0)
    assert np.array_equal(cap_cover_surface(cloud, 1.0), expected)
    if count == 60:
        assert 0 < expected.sum() < count


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
