"""The signed distance from a mesh, which meshes are refused, and boundary particles: number, evenness, seeds."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from refsim.backends.arrays import on_threads
from refsim.boundary.sampling import sample
from refsim.boundary.signed_distance import signed_distance
from refsim.boundary.signed_distance.cases import needle, plate
from refsim.core.errors import InputError
from refsim.scene.surface_mesh import surface_mesh
from refsim.sparse_grid.reference import node_table
from refsim.winding_number.reference import solid_angles
from tests.running import rows

BALL = trimesh.creation.icosphere(3)
BOX = trimesh.creation.box((1.0, 0.8, 0.6))


def meshed(made):
    return surface_mesh(made.vertices, made.faces)


@pytest.fixture(scope="module")
def ball_band():
    return signed_distance(meshed(BALL), 0.06)


def node_places(band):
    return band.spacing * node_table(band.field)


def test_distance_is_that_of_trimesh_and_projection_stands_on_the_mesh(ball_band):
    place = node_places(ball_band)
    rows = np.random.default_rng(1).choice(np.flatnonzero(ball_band.field.closest >= 0), 300, replace=False)
    _, distance, _ = trimesh.proximity.closest_point(BALL, place[rows])
    assert np.abs(np.abs(ball_band.field.distance[rows]) - distance).max() < 3e-7
    beyond = np.flatnonzero(ball_band.field.closest < 0)[:100]
    assert trimesh.proximity.closest_point(BALL, place[beyond])[1].min() > ball_band.band * (1 - 1e-6)
    directions = np.random.default_rng(6).normal(size=(300, 3))
    place = (directions / np.linalg.norm(directions, axis=1)[:, None] * 1.003).astype(np.float32)
    onto, normal = ball_band.project(place)
    _, least, _ = trimesh.proximity.closest_point(BALL, place)
    _, off, _ = trimesh.proximity.closest_point(BALL, onto)
    assert off.max() < 1e-6
    assert np.abs(np.linalg.norm(onto - place, axis=1) - least).max() < 0.05 * ball_band.spacing
    assert np.abs(np.linalg.norm(normal, axis=1) - 1).max() < 1e-5


@pytest.mark.parametrize("shape, spacing", [(needle, 0.004), (plate, 0.02)], ids=["needle", "plate"])
def test_signs_are_those_of_the_winding_number(shape, spacing):
    """At random nodes, also where two faces of a sharp tip are equally near."""
    band = signed_distance(shape(), spacing, 2 * spacing, dtype="float64")
    place = node_places(band)
    clear = np.abs(band.field.distance) > 1e-9
    rows = np.random.default_rng(2).choice(np.flatnonzero(clear), 1500, replace=False)
    corners = band.mesh.corners
    inside = solid_angles(place[rows], corners).sum(1) > 2 * np.pi
    assert inside.any()
    assert np.array_equal(band.field.distance[rows] < 0, inside)


# Meshes that are repaired, with a note
def test_a_small_hole_is_filled_and_a_cavity_is_kept():
    mesh = surface_mesh(BOX.vertices, BOX.faces[1:])
    assert mesh.notes[0].startswith("assumed of the mesh: holes filled with 1 triangle, 6.4 % of the surface")
    assert mesh.volume == pytest.approx(0.48)
    inner = 0.5 * np.array(BOX.vertices)
    hollow = surface_mesh(np.concatenate([BOX.vertices, inner]), np.concatenate([BOX.faces, BOX.faces[:, ::-1] + 8]))
    assert (hollow.notes, hollow.volume) == ((), pytest.approx(0.48 * 7 / 8))
    distance, _ = signed_distance(hollow, 0.04).at(np.array([[0.0, 0.0, 0.0], [0.38, 0.0, 0.0]]))
    assert distance[0] > 0 > distance[1]


# Meshes that are refused, each in one sentence
def strip():
    """A Moebius strip."""
    turn = np.linspace(0, 2 * np.pi, 21)[:-1]
    across = np.stack([np.cos(turn / 2) * np.cos(turn), np.cos(turn / 2) * np.sin(turn), np.sin(turn / 2)], 1)
    ring = np.stack([np.cos(turn), np.sin(turn), 0 * turn], 1)
    corner = np.stack([ring - 0.3 * across, ring + 0.3 * across], 1).reshape(-1, 3)
    k = np.arange(20)
    a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3
    c[-1], d[-1] = 1, 0
    return corner, np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def nested():
    return np.concatenate([BOX.vertices, 0.5 * BOX.vertices]), np.concatenate([BOX.faces, BOX.faces + 8])


NOT_FINITE = np.where(np.arange(24).reshape(8, 3) == 4, np.nan, BOX.vertices)


@pytest.mark.parametrize(
    "given, words",
    [
        (nested(), "a body inside another body"), ((NOT_FINITE, BOX.faces), "not finite"),
        ((BOX.vertices, np.zeros((0, 3), int)), "has no triangles"), ((np.zeros((3, 3)), [[0, 1, 2]]), "has no extent"),
        ((BOX.vertices, [[0, 1, 99]]), "not there"), (strip(), "one side only"),
    ],
    ids=["nested", "nan", "empty", "point", "index", "moebius"],
)  # fmt: skip
def test_what_cannot_be_repaired_is_refused(given, words):
    with pytest.raises(InputError, match=words) as caught:
        surface_mesh(*given)
    assert str(caught.value).count(". ") == 0


ON_BALL = surface_mesh(trimesh.creation.icosphere(3).vertices, trimesh.creation.icosphere(3).faces, "ball")
ON_BOX = surface_mesh(*(lambda m: (m.vertices, m.faces))(trimesh.creation.box((1.0, 1.0, 1.0))), "box")


def test_particles_are_even_and_on_the_mesh_and_the_same_by_their_seed():
    on_ball = sample(ON_BALL, 0.08, seed=1)
    assert on_ball.converged
    assert len(on_ball.position) == pytest.approx(on_ball.expected, abs=1)
    nearest = cKDTree(on_ball.position).query(on_ball.position, k=2)[0][:, 1]
    assert nearest.min() / nearest.mean() > 0.85
    assert nearest.std() / nearest.mean() < 0.05
    made = trimesh.Trimesh(ON_BALL.vertices, ON_BALL.faces)
    assert trimesh.proximity.closest_point(made, on_ball.position)[1].max() < 1e-5 * on_ball.radius / 0.08
    outward = (on_ball.normal * on_ball.position).sum(1) / np.linalg.norm(on_ball.position, axis=1)
    assert outward.min() > 0.98
    with on_threads(1):
        again = sample(ON_BALL, 0.08, seed=1)
    assert np.array_equal(on_ball.position, again.position)
    assert np.array_equal(on_ball.normal, again.normal)
    other = sample(ON_BALL, 0.08, seed=2)
    assert not np.array_equal(on_ball.position, other.position)
    large, small = (sample(surface_mesh(k * ON_BALL.vertices, ON_BALL.faces), 0.3 * k, seed=1) for k in (100.0, 1.0))
    assert large.position == pytest.approx(100 * small.position, abs=0.1)


def test_a_box_keeps_its_edges_and_the_printed_step_does_not_converge():
    made = sample(ON_BOX, 0.06)
    assert made.converged
    assert len(made.position) == pytest.approx(made.expected, abs=1)
    assert np.abs(np.abs(made.position).max(1) - 0.5).max() < 1e-6
    printed = sample(ON_BOX, 0.06, literal=("E24",), most_iterations=300)
    assert not printed.converged
    assert "still move" in printed.notes[-1]
    assert sample(ON_BOX, 0.06, most_iterations=300).converged


@pytest.mark.parametrize("options, words", rows(__file__, "bad_samples"))
def test_bad_input_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        sample(ON_BALL, **options)
