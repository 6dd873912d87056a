"""The yardsticks themselves, held against answers that can be worked out by hand or by another program."""

from itertools import combinations

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from validation.metrics import dam_break, droplet, shapes
from validation.metrics.surface_truth import arc_cover_surface, cap_cover_surface, detection_score


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


def test_detection_score_counts():
    truth = [1, 1, 1, 1, 0, 0, 0, 0, 0, 0]
    flags = [1, 1, 1, 0, 1, 1, 0, 0, 0, 0]
    score = detection_score(flags, truth)
    assert (score.precision, score.recall) == (pytest.approx(3 / 5), pytest.approx(3 / 4))
    assert (score.f1, (score.false_interior, score.false_surface)) == (pytest.approx(2 / 3), (1, 2))
    nothing = detection_score([0, 0], [0, 1])
    assert np.isnan(nothing.precision)
    assert (nothing.recall, nothing.f1) == (0, 0)


# Shapes
def test_rotated_lattice_cube_is_a_lattice_cut_by_a_cube():
    for count in (1, 100, 5039):
        cut = shapes.rotated_lattice_cube(count, seed=2, spacing=0.1)
        assert cut.position.shape == (count, 3)
        assert np.abs(cut.position).max() < cut.side / 2
        assert cut.side == pytest.approx(0.1 * count ** (1 / 3), rel=0.02 if count > 1000 else 0.6)
    site = cut.position @ cut.rotation / 0.1
    site -= site[0]
    assert np.abs(site - np.rint(site)).max() < 1e-9
    assert np.linalg.det(cut.rotation) == pytest.approx(1)
    assert np.abs(cut.rotation).max() < 0.99  # really turned
    middle = cut.position[np.argmin(np.linalg.norm(cut.position, axis=1))]
    lattice = (grid(41, 41, 41) - 20) @ cut.rotation.T * 0.1 + middle  # far beyond the cube
    assert (np.abs(lattice) < cut.side / 2).all(axis=1).sum() == 5039  # no site of the cube is missing
    again = shapes.rotated_lattice_cube(5039, seed=2, spacing=0.1)
    assert np.array_equal(again.position, cut.position)
    assert not np.allclose(shapes.rotated_lattice_cube(5039, seed=4, spacing=0.1).position, cut.position)


# Droplet
def test_radius_variation_of_lattice_shapes():
    scale = droplet.radius_variation_scale(4913)
    assert (round(scale.ball, 4), scale.cube) == (0.0094, pytest.approx(0.148, abs=5e-4))
    ball = shapes.lattice_ball(4913)
    assert round(droplet.radius_variation(ball, cone=15), 4) == 0.0042
    assert droplet.radius_variation(ball * 1e-3 + [5.0, -2.0, 1.0]) == pytest.approx(scale.ball, rel=1e-9)


def test_cubic_moment_tells_cube_ball_and_octahedron():
    cube = shapes.lattice_cube(17)
    # sums over -8..8: <x^2> = 24, <x^4> = 1032
    assert droplet.cubic_moment(cube) == pytest.approx((3 * 1032) / (3 * 1032 + 6 * 24**2) - 0.6, rel=1e-12)
    assert droplet.cubic_moment(cube + 5.0) == pytest.approx(-0.12747, abs=1e-5)
    assert abs(droplet.cubic_moment(shapes.lattice_ball(4913))) < 0.01
    corner = np.vstack((np.eye(3), -np.eye(3)))
    assert droplet.cubic_moment(corner) == pytest.approx(0.4)
    turn = Rotation.random(rng=np.random.default_rng(0)).as_matrix()
    assert droplet.cubic_moment(cube @ turn.T, axes=turn) == pytest.approx(droplet.cubic_moment(cube))
    assert droplet.cubic_moment(cube @ turn.T) != pytest.approx(droplet.cubic_moment(cube), abs=1e-3)


def layered_ball(layers):
    """Concentric shells of even points, spacing about 1: a relaxed drop of known roundness."""
    shell = [droplet.fibonacci_directions(round(4 * np.pi * (k**2 + 1 / 12))) * k for k in range(1, layers + 1)]
    return np.vstack([np.zeros((1, 3)), *shell])


def test_surface_mesh_of_a_round_drop_is_a_smooth_sphere():
    point = layered_ball(10)
    vertices, faces = droplet.surface_mesh(point, 1.0)
    radius = np.linalg.norm(vertices - point.mean(axis=0), axis=1)
    assert radius.std() / radius.mean() < 2e-3
    assert droplet.sphericity(vertices, faces) > 0.9995
    # half a spacing outside the last shell, less the Gaussian's shift of one squared over R
    assert radius.mean() == pytest.approx(10.5 - 1 / 10.5, abs=0.03)
    assert droplet.mesh_volume(vertices, faces) == pytest.approx(4 / 3 * np.pi * radius.mean() ** 3, rel=3e-3)
    moved, _ = droplet.surface_mesh(point * 1e-3 + 7.0, 1e-3)
    assert moved == pytest.approx(vertices * 1e-3 + 7.0, abs=1e-6)


def test_surface_mesh_of_a_cube_has_flat_faces_half_a_spacing_out():
    vertices, faces = droplet.surface_mesh(shapes.lattice_cube(13), 1.0, smoothing=0.8)
    middle = vertices[(np.abs(vertices[:, :2]) < 3).all(axis=1) & (vertices[:, 2] > 0)]
    assert np.abs(middle[:, 2] - 6.5).max() < 0.01
    assert 0.806 < droplet.sphericity(vertices, faces) < 0.9
    assert droplet.mesh_volume(vertices, faces) == pytest.approx(13**3, rel=0.04)  # the edges are rounded


def test_mesh_measures_of_a_tetrahedron_and_a_cube():
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    face = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    assert droplet.mesh_volume(corner + 100.0, face) == pytest.approx(1 / 6)
    assert droplet.mesh_area(corner, face) == pytest.approx(1.5 + np.sqrt(3) / 2)
    assert droplet.mesh_volume(corner, face[:, ::-1]) == pytest.approx(-1 / 6)
    with pytest.raises(ValueError, match="positive volume"):
        droplet.sphericity(corner, face[:, ::-1])
    with pytest.raises(ValueError, match="not closed"):
        droplet.mesh_volume(corner, face[:3])
    with pytest.raises(ValueError, match="not closed"):
        droplet.mesh_volume(corner, np.vstack((face[:3], face[3:, ::-1])))
    box = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    side = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangle = np.array([t for a, b, c, d in side for t in ((a, b, c), (a, c, d))])
    assert droplet.sphericity(box * 3, triangle) == pytest.approx((np.pi / 6) ** (1 / 3))


# Dam break
def test_datasets_are_the_published_series():
    size = {"martin_moyce_1.125in": 10, "martin_moyce_2.25in": 15, "koshizuka_oka": 9, "koshizuka_oka_mps": 18}
    assert set(dam_break.FRONT_DATA) == set(size)
    for name, points in size.items():
        series = dam_break.load_front_data(name)
        assert len(series.time) == len(series.front) == points
        assert (np.diff(series.front) > 0).all()
        assert series.front[0] >= 1
        assert (np.diff(series.time) > 0).all()
        assert (series.front <= dam_break.ritter_front(series.time) + 0.005).all()
    assert dam_break.load_front_data("koshizuka_oka").front[4] == 1.892


def planted(offset):
    """A smooth front, and data read from it by a clock that runs behind by ``offset``."""
    time = np.linspace(0, 5, 400)
    at = np.array([0.6, 1.1, 1.9, 2.4, 3.3, 3.9])
    front = 1 + 2 * time**2 / (time + 1.5)
    return time, front, dam_break.FrontData(at, np.interp(at + offset, time, front))


@pytest.mark.parametrize("offset", [-0.37, 0.0, 0.125, 0.41])
def test_offset_fit_finds_a_planted_offset(offset):
    time, front, data = planted(offset)
    fit = dam_break.fit_time_offset(time, front, data)
    assert fit.offset == pytest.approx(offset, abs=1e-5)
    assert fit.rms < 1e-5
    assert fit.points == 6
    assert not fit.at_limit
    error = dam_break.front_error(time, front, data, fit.offset)
    assert abs(error.largest) < 1e-5
    assert error.points == 6
    assert dam_break.front_error(time, front, data).rms >= 0.3 * abs(offset)


def test_front_error_is_relative_to_the_data():
    data = dam_break.FrontData(np.array([1.0, 2.0, 3.0, 9.0]), np.array([2.0, 4.0, 5.0, 20.0]))
    error = dam_break.front_error([0.0, 4.0], [1.0, 5.0], data)  # 2, 3, 4 there; the last point is out of reach
    assert (error.largest, error.at, error.points) == (pytest.approx(-0.25), 2.0, 3)
    assert error.rms == pytest.approx(np.sqrt((0.25**2 + 0.2**2) / 3))


def test_front_position_leaves_spray_out():
    column = (grid(10, 20) + 0.5) * 0.1
    front = dam_break.front_position(column, 0.1)
    assert (front.connected, front.farthest, front.detached) == (pytest.approx(1.0), pytest.approx(1.0), 0)
    spray = np.vstack((column, [[1.7, 0.05], [1.8, 0.05], [2.5, 0.4]]))
    front = dam_break.front_position(spray, 0.1)
    assert (front.connected, front.farthest, front.detached) == (pytest.approx(1.0), pytest.approx(2.55), 3)
    tongue = np.vstack((column, [[1.1, 0.05], [1.25, 0.05], [1.4, 0.05]]))
    assert dam_break.front_position(tongue, 0.1).connected == pytest.approx(1.45)
    assert dam_break.front_position(tongue, 0.1, link=1.2).connected == pytest.approx(1.0)
    assert dam_break.front_position(column[:, ::-1], 0.1, axis=1).connected == pytest.approx(1.0)
    assert dam_break.front_position(column[:1], 0.1).connected == pytest.approx(0.1)


def test_neighbour_search_is_completed_in_dense_clumps():
    """More neighbours than one search returns: what decides must not be the number looked at."""
    rng = np.random.default_rng(8)
    for dim in (2, 3):
        clump = rng.normal(0, 1e-3, (150, dim))
        answer = COVER[dim](clump, 1.0)
        # R is a thousand times the clump's size, so the probe is all but flat: the convex hull
        assert np.array_equal(np.flatnonzero(answer), np.sort(ConvexHull(clump).vertices))
