"""Surface normals and surface detection: what they must do whatever the numbers."""

import math

import numpy as np
import pytest

from refsim import Ball, Box, Cloud, InputError, Scene, Simulation, SurfaceDetection, WeaklyCompressible
from refsim.core.effect import Discretisation
from refsim.scene.plan import make_plan
from tests.running import rows
from validation.metrics.surface_truth import arc_cover_surface

METHODS = ("number_density", "fan_scan", "two_step")
PROBE = 1.2  # radius of the truth's probe, in spacings
CENTER = np.array([0.63, 0.77, 0])  # of the disc


def lattice(part, dim=2):
    return part.positions(Discretisation(dim, "float64", 1.0, 2.6, 0))


def disc(radius=10.2):
    """A disc cut off centre, so that no normal lies exactly on a diagonal: there a neighbour would be a tie."""
    block = lattice(Box(cells=(30, 30, 1))) - [15, 15, 0]
    return block[np.linalg.norm(block - CENTER, axis=1) < radius]


def detect(
    position, backend="numpy", dtype="float64", spacing=1.0, dim=2, ratio=2.6, walls=(), crowded=False, **settings
):
    """A simulation whose fields belong to the given positions; these are in spacings.

    Crowded ones, which no scene may start with, are set between two steps.
    """
    scene = Scene(
        spacing=spacing, support_radius=ratio * spacing, dim=dim, dtype=dtype,
        fluid=(Cloud(position=position * spacing * (2.0 if crowded else 1.0)),),
        effects=(WeaklyCompressible(sound_speed=10.0, density="summation"), SurfaceDetection(**settings), *walls),
    )  # fmt: skip
    simulation = Simulation(scene, backend)
    if crowded:
        simulation.set_field("position", position * spacing)
    simulation.evaluate()
    return simulation


def surface(position, **options):
    return detect(position, **options).field("surface").astype(bool)


def turned(position, angle):
    c, s = math.cos(angle), math.sin(angle)
    return position @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


# What is found


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.1])
@pytest.mark.parametrize("method", ["fan_scan", "two_step"])
def test_ring_of_a_disc_is_found_exactly_at_any_angle(method, angle):
    position = turned(disc(7.4), angle)
    truth = arc_cover_surface(position[:, :2], PROBE)
    np.testing.assert_array_equal(surface(position, method=method), truth)


def test_a_missing_particle_makes_no_surface_but_a_hole_does():
    block = lattice(Box(cells=(21, 21, 1))) - [10.5, 10.5, 0]
    inner = np.abs(block[:, :2]).max(1) < 8
    cavity = np.hypot(block[:, 0], block[:, 1]) > 0.5
    hole = np.hypot(block[:, 0] - 0.13, block[:, 1] - 0.27) > 3.2
    assert not surface(block[cavity])[inner[cavity]].any()
    found, truth = surface(block[hole]), arc_cover_surface(block[hole][:, :2], PROBE)
    np.testing.assert_array_equal(found, truth)
    assert found[inner[hole]].any()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("method", METHODS)
def test_spray_is_surface(method, count, dim):
    assert surface(np.arange(count)[:, None] * [0.6, 0.8, 0.0], dim=dim, method=method).all()


# As part of a scene
def plan_of(*effects, dim=2):
    scene = Scene(
        spacing=1.0, support_radius=2.6, dim=dim, fluid=(Ball(radius=3.0),),
        effects=(WeaklyCompressible(sound_speed=1.0, density="summation"), *effects),
    )  # fmt: skip
    return make_plan(scene)


@pytest.mark.parametrize(("settings", "words"), rows(__file__, "bad_settings"))
def test_bad_settings_get_one_sentence(settings, words):
    with pytest.raises(InputError, match=r"^surface_detection: ") as caught:
        plan_of(SurfaceDetection(**settings))
    assert words in str(caught.value)
