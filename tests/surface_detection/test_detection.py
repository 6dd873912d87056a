"""Surface detection: what it must do whatever the numbers, and at all support radii what `refsim plan` says of it."""

import itertools
import math

import numpy as np
import pytest

from refsim import Box, Cloud, Scene, Simulation, SurfaceDetection, WeaklyCompressible
from refsim.core.effect import Discretisation
from refsim.scene.plan import make_plan
from validation.metrics.surface_truth import arc_cover_surface

METHODS = ("number_density", "fan_scan", "two_step")
PROBE = 1.2  # radius of the truth's probe, in spacings
CENTER = np.array([0.63, 0.77, 0])  # of the disc


def lattice(part):
    return part.positions(Discretisation(2, "float64", 1.0, 2.6, 0))


def disc(radius):
    """A disc cut off centre, so that no normal lies exactly on a diagonal: there a neighbour would be a tie."""
    block = lattice(Box(cells=(30, 30, 1))) - [15, 15, 0]
    return block[np.linalg.norm(block - CENTER, axis=1) < radius]


def surface(position, dim=2, **settings):
    """Flags of particles at these positions [spacings]."""
    effects = (WeaklyCompressible(sound_speed=10.0, density="summation"), SurfaceDetection(**settings))
    scene = Scene(
        spacing=1.0, support_radius=2.6, dim=dim, dtype="float64", fluid=(Cloud(position=position),), effects=effects
    )
    return Simulation(scene, "numpy").field("surface").astype(bool)


def turned(position, angle):
    c, s = math.cos(angle), math.sin(angle)
    return position @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])


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


SUPPORTS = (1.05, 1.1, 1.2, 1.3, 1.4, 2**0.5, 1.5, 1.6, 1.7, 1.8, 2.0, 2.3, 2.6, 3.0, 3.2, 3.5, 4.0, 4.5)
CASES = [
    pytest.param(dim, r, marks=[pytest.mark.slow] * (r in between))
    for dim, supports, between in (
        (2, SUPPORTS, (1.1, 1.3, 1.6, 1.8, 2.3, 3.0, 3.5, 4.0)),
        (3, (1.05, 1.2, 1.4, 1.6, 2.0, 2.6, 3.2, 4.5), (1.2, 1.6, 3.2)),
    )
    for r in supports
]
CELLS = {2: (12, 12, 1), 3: (8, 8, 8)}


def block(dim, jitter=0.0):
    """(places, layer of each from the nearest face), in spacings."""
    axes = [np.arange(n) + 0.5 if n > 1 else np.zeros(1) for n in CELLS[dim]]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    count = CELLS[dim][0]
    layer = np.minimum(place, count - place)[:, :dim].min(1).astype(int)
    place[:, :dim] += np.random.default_rng(3).uniform(-jitter, jitter, (len(place), dim))
    return place, layer


def scene(dim, ratio, place, kernels="wendland", **settings):
    liquid = WeaklyCompressible(sound_speed=10.0, kernels=kernels, density="summation")
    cloud, effects = Cloud(position=0.05 * place), (liquid, SurfaceDetection(**settings))
    return Scene(dim=dim, spacing=0.05, support_radius=ratio * 0.05, dtype="float64", fluid=(cloud,), effects=effects)


def said(made):
    return [note for note in make_plan(made).notes if note.startswith("surface_detection:")]


@pytest.mark.parametrize("dim, ratio", CASES)
def test_within_the_range_that_plan_gives_the_surface_of_shaken_liquid_is_found(dim, ratio):
    """Particles a tenth of a spacing off: at least 97 % of the surface; the scans mark no particle inside."""
    place, layer = block(dim, 0.1)
    for method, kernels in itertools.product(METHODS, ("wendland", "mueller")):
        made = scene(dim, ratio, place, method=method, kernels=kernels)
        if said(made):
            continue
        found = Simulation(made, "numpy").field("surface").astype(bool)
        assert found[layer == 0].mean() >= 0.97, (method, kernels)
        assert method == "number_density" or not found[layer > 0].any(), (method, kernels)


@pytest.mark.parametrize("method, low, high", [("two_step", 2, 6), ("fan_scan", 2, 6), ("number_density", 2, 4.5)])
def test_plan_says_the_range_in_which_the_detector_is_right(method, low, high):
    place = block(3)[0]
    for ratio in (low, 2.6, high):
        assert not said(scene(3, ratio, place, method=method))
    for ratio in (1.05, 1.5, low - 0.01, high + 0.01):
        (note,) = said(scene(3, ratio, place, method=method))
        assert f"finds the surface at support radii of {low:g} to {high:g} spacings; at {ratio:.3g} it" in note
