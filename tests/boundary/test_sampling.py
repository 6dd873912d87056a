"""Boundary particles on meshes: number, evenness, repeatability, refused input."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from refsim.backends.arrays import on_threads
from refsim.boundary.mesh import surface_mesh
from refsim.boundary.sampling import sample
from refsim.core.errors import InputError
from tests.running import rows

BALL = surface_mesh(trimesh.creation.icosphere(3).vertices, trimesh.creation.icosphere(3).faces, "ball")
BOX = surface_mesh(*(lambda m: (m.vertices, m.faces))(trimesh.creation.box((1.0, 1.0, 1.0))), "box")


@pytest.fixture(scope="module")
def on_ball():
    return sample(BALL, 0.08, seed=1)


def test_particles_are_even_and_on_the_mesh_and_the_same_by_their_seed(on_ball):
    assert on_ball.converged
    assert len(on_ball.position) == pytest.approx(on_ball.expected, abs=1)
    nearest = cKDTree(on_ball.position).query(on_ball.position, k=2)[0][:, 1]
    assert nearest.min() / nearest.mean() > 0.85
    assert nearest.std() / nearest.mean() < 0.05
    made = trimesh.Trimesh(BALL.vertices, BALL.faces)
    assert trimesh.proximity.closest_point(made, on_ball.position)[1].max() < 1e-5 * on_ball.radius / 0.08
    outward = (on_ball.normal * on_ball.position).sum(1) / np.linalg.norm(on_ball.position, axis=1)
    assert outward.min() > 0.98
    with on_threads(1):
        again = sample(BALL, 0.08, seed=1)
    assert np.array_equal(on_ball.position, again.position)
    assert np.array_equal(on_ball.normal, again.normal)
    other = sample(BALL, 0.08, seed=2)
    assert not np.array_equal(on_ball.position, other.position)
    large, small = (sample(surface_mesh(k * BALL.vertices, BALL.faces), 0.3 * k, seed=1) for k in (100.0, 1.0))
    assert large.position == pytest.approx(100 * small.position, abs=0.1)


def test_a_box_keeps_its_edges_and_the_printed_step_does_not_converge():
    made = sample(BOX, 0.06)
    assert made.converged
    assert len(made.position) == pytest.approx(made.expected, abs=1)
    assert np.abs(np.abs(made.position).max(1) - 0.5).max() < 1e-6
    printed = sample(BOX, 0.06, literal=("E24",), most_iterations=300)
    assert not printed.converged
    assert "still move" in printed.notes[-1]
    assert sample(BOX, 0.06, most_iterations=300).converged


@pytest.mark.parametrize("options, words", rows(__file__, "bad_samples"))
def test_bad_input_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        sample(BALL, **options)
