"""Stages by which triangles become a body, each against loops over triangles, pairs, boxes and cells."""

import collections
import itertools
import types

import numpy as np
import pytest

from refsim.boundary.one_way_coupling.placing import PlacedSolid
from refsim.scene import overlaps, surface_mesh
from tests.boundary.test_recorded_boundary import BOX, divided


def test_faces_that_stand_twice_are_left_out():
    """By a count of each: one with both windings goes if its edges are closed without it, else it stays once."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        vertices, faces = divided(*BOX)
        more = faces[rng.integers(len(faces), size=rng.integers(0, 5))]
        flipped = faces[rng.integers(len(faces), size=rng.integers(0, 4))][:, ::-1]
        loose = rng.integers(0, len(vertices), (rng.integers(0, 3), 3))
        pairs = np.concatenate([loose, loose[:, ::-1]])
        given = rng.permuted(np.concatenate([faces, more, flipped, pairs]), axis=0)
        turn = rng.integers(0, 3, len(given))
        given = np.array([np.roll(face, k) for face, k in zip(given, turn)])
        said, sets = [], collections.defaultdict(list)
        for k, face in enumerate(given):
            if len(set(face.tolist())) == 3:
                low = int(np.argmin(face))
                sets[frozenset(face.tolist())].append((k, tuple(np.roll(face, -low).tolist())))
        both = {key for key, rows in sets.items() if len({way for _, way in rows}) > 1}
        edges = collections.Counter(
            frozenset(edge) for key in sets if key not in both for edge in itertools.combinations(key, 2)
        )
        lost = set()
        if 2 * len(both) <= len(sets):
            lost = {key for key in both if not any(edges[frozenset(e)] % 2 for e in itertools.combinations(key, 2))}
        expected = sorted(rows[0][0] for key, rows in sets.items() if key not in lost)
        assert surface_mesh._once(given, said).tolist() == given[expected].tolist()
        whole = sum(map(len, sets.values()))
        assert bool(said) == (len(expected) < whole)
        assert not said or said[0].startswith(f"{whole - len(expected)} face")


def crossing_of(one, other):
    """Ends of the segment in which two triangles cross, by the points in which sides of one pass through the other."""
    found = []
    for corners, face in ((one, other), (other, one)):
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        for k in range(3):
            a, b = corners[k], corners[(k + 1) % 3]
            above, below = (a - face[0]) @ normal, (b - face[0]) @ normal
            if above * below >= 0:
                continue
            at = a + above / (above - below) * (b - a)
            inside = [np.cross(face[(i + 1) % 3] - face[i], at - face[i]) @ normal > 0 for i in range(3)]
            found += [at] * all(inside)
    return found


def test_triangles_cross_in_the_segment_between_their_sides():
    rng, met = np.random.default_rng(8), 0
    one, other = rng.normal(size=(2, 300, 3, 3))
    a, b = overlaps.unit_normals(one), overlaps.unit_normals(other)
    high = [((x - y[:, :1]) * n[:, None]).sum(2) for x, y, n in ((one, other, b), (other, one, a))]
    ends, length = overlaps._common_line(one, other, high, a, b, 1e-12)
    for k in range(300):
        points = crossing_of(one[k], other[k])
        if len(points) == 2 and not (np.abs(high[0][k]).min() < 1e-9):
            met += 1
            assert length[k] == pytest.approx(np.linalg.norm(points[1] - points[0]))
            found, expected = (np.array(sorted(map(tuple, np.round(pair, 9)))) for pair in (ends[k], points))
            assert found == pytest.approx(expected)
    assert met > 30


@pytest.mark.parametrize("count", [1, 2, 9, 33, 70])
def test_boxes_that_overlap_are_found_in_their_tree(count):
    rng = np.random.default_rng(count)
    corners = rng.uniform(0, 2.5, (count, 1, 3)) + rng.uniform(0, 0.4, (count, 3, 3))
    low, high = corners.min(1) - 0.05, corners.max(1) + 0.05
    found = [tuple(sorted(pair)) for pairs in overlaps._near_pairs(corners, 0.1) for pair in pairs.tolist()]
    expected = {
        (i, j) for i in range(count) for j in range(i) if (low[i] <= high[j]).all() and (low[j] <= high[i]).all()
    }
    assert sorted(found) == sorted((j, i) for i, j in expected)


def egg(points):
    """Distance of points (n, 3) to a ball about (0.52, 0.48, 0.5) with a radius of 0.4."""
    return np.linalg.norm(points - [0.52, 0.48, 0.5], axis=1) - 0.4


def solid(distance=egg):
    mesh = types.SimpleNamespace(
        vertices=BOX[0] * 0.8 - 0.4, origin=np.array([0.52, 0.48, 0.5]), faces=BOX[1], source="egg.obj"
    )
    return PlacedSolid(mesh, None, None, (), types.SimpleNamespace(at=lambda points: (distance(points), None)), ())


def share_of(point, size):
    """What the egg fills of a box, by the depth of 64 places of it, and the centre of that."""
    if abs(egg(point[None])[0]) >= 0.5 * 3**0.5 * max(size):
        return float(egg(point[None])[0] < 0), point
    steps = [((k + 0.5) / 4 - 0.5) for k in range(4)]
    inner = np.array([point + np.array(step) * size for step in itertools.product(steps, repeat=3)])
    part = [min(max(0.5 - 4 * d / min(size), 0.0), 1.0) for d in egg(inner)]
    middle = sum(p * x for p, x in zip(part, inner)) / sum(part) if sum(part) else 0 * point
    return sum(part) / 64, middle


def test_a_body_fills_shares_of_boxes():
    rng = np.random.default_rng(1)
    points, sizes = rng.uniform(0, 1, (80, 3)), rng.choice([0.06, 0.1, 0.17], (80, 3))
    for size in (sizes, 0.1):
        share, centre = solid().filled(points, size)
        for k, point in enumerate(points):
            part, middle = share_of(point, np.broadcast_to(size, (80, 3))[k])
            assert share[k] == pytest.approx(part, abs=1e-12)
            assert centre[k] == pytest.approx(middle, abs=1e-12)
    assert ((share > 0) & (share < 1)).sum() > 20
