"""Detection at all support radii: what `refsim plan` says of its limits holds."""

import itertools

import numpy as np
import pytest

from refsim import Cloud, Scene, Simulation, SurfaceDetection, WeaklyCompressible
from refsim.scene.plan import make_plan

SUPPORTS = (1.05, 1.1, 1.2, 1.3, 1.4, 2**0.5, 1.5, 1.6, 1.7, 1.8, 2.0, 2.3, 2.6, 3.0, 3.2, 3.5, 4.0, 4.5)
CASES = [
    pytest.param(dim, r, marks=[pytest.mark.slow] * (r in between))
    for dim, supports, between in (
        (2, SUPPORTS, (1.1, 1.3, 1.6, 1.8, 2.3, 3.0, 3.5, 4.0)),
        (3, (1.05, 1.2, 1.4, 1.6, 2.0, 2.6, 3.2, 4.5), (1.2, 1.6, 3.2)),
    )
    for r in supports
]
METHODS = ("two_step", "number_density", "fan_scan")
CELLS = {2: (12, 12, 1), 3: (8, 8, 8)}


def block(dim, jitter=0.0):
    """(places, layer of each from the nearest face), in spacings."""
    axes = [np.arange(n) + 0.5 if n > 1 else np.zeros(1) for n in CELLS[dim]]
    place = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    count = CELLS[dim][0]
    layer = np.minimum(place, count - place)[:, :dim].min(1).astype(int)
    place[:, :dim] += np.random.default_rng(3).uniform(-jitter, jitter, (len(place), dim))
    return place, layer


def scene(dim, ratio, place, *others, kernels="wendland", dtype="float64", spacing=0.05, **settings):
    liquid = WeaklyCompressible(sound_speed=10.0, kernels=kernels, density="summation")
    effects = (liquid, SurfaceDetection(**settings), *others)
    cloud = Cloud(position=spacing * place)
    return Scene(dim=dim, spacing=spacing, support_radius=ratio * spacing, dtype=dtype, fluid=(cloud,), effects=effects)


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
