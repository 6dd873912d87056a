"""Tension at the edge of the support: which terms do not vanish at r = h, and how far they jump there."""

import math

import numpy as np
import pytest

from refsim import Akinci2013, Ball, WeaklyCompressible
from refsim.contract import Inputs, Target
from refsim.contract.bounds import oracle
from refsim.core.cases import Case
from refsim.core.effect import Discretisation
from refsim.core.operation import REGISTRY
from refsim.smoothing import smoothing
from refsim.smoothing.reference import kernel_value
from refsim.sph import SETS

FOLDER = "refsim.surface_tension."
JUMPING = {
    "akinci_2013.tension",
    "akinci_2013.tension:fused",
    "jiang_zhu_2023.area",
    "jiang_zhu_2023.tension",
    "jiang_zhu_2023.tension:fused",
    "normal_difference_2014.tension",
}
NEAR = 1e-10  # of h
dims = pytest.mark.parametrize("dim", [2, 3])


def steepest(shape, dim, h=1.0):
    """h int W dA over a plane (line) through the particle: the length of the normal J(19) of a half-space of liquid.

    No other shape has a longer normal: in int grad W over a half-space all contributions have the same sign.
    """
    node, weight = np.polynomial.legendre.leggauss(200)
    r, dr = 0.5 * h * (node + 1), 0.5 * h * weight
    ring = 2 * math.pi * r if dim == 3 else 2.0
    return h * float((ring * kernel_value(r, smoothing(shape, h, dim)) * dr).sum())


def tension_sums():
    """Operations of the tension models, fused ones too, that sum over pairs, with the number of each variant."""
    for operation in REGISTRY.values():
        sums = "position" in operation.arguments("numpy") and "acceleration" in operation.outputs
        if operation.folder.startswith(FOLDER) and sums and operation.name != "akinci_2013.adhesion":
            for judged in (operation, *map(operation.as_computed_by, operation.programs)):
                yield from ((judged, variant) for variant in range(len(judged.variants)))


def across(operation, variant, distance):
    """Acceleration of a pair at a distance [h], by the reference, without walls."""
    h = 0.2
    case = Case("edge", 3, np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.8]]) * distance * h, spacing=0.1, support_radius=h)
    target = Target(operation, "numpy", "float64", variant)
    given = {"velocity": np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]])}
    given |= {name: np.array([0.5, 1.0]) for name in ("surface_weight",)}
    given |= {"surface": np.array([1, 1], np.uint8)}
    for name in ("area_normal", "surface_normal"):
        given[name] = np.array([[0.3, -0.2, 0.9], [-0.5, 0.1, 0.4]])
    inputs = target.varied(Inputs(case, "float64").replaced(**given))
    return oracle(operation, inputs)["acceleration"][0]


def test_only_the_area_terms_jump_at_the_edge_of_the_support():
    """Every other pair term of every tension model vanishes there."""
    jumping = set()
    for operation, variant in tension_sums():
        inside, outside = across(operation, variant, 1 - NEAR), across(operation, variant, 1 + NEAR)
        largest = max(np.abs(across(operation, variant, q)).max() for q in (0.3, 0.5, 0.7, 0.9))
        if np.abs(inside - outside).max() > 1e-6 * largest:
            jumping.add(operation.name)
            assert "does not vanish at r = h" in operation.tolerance_reason
    assert jumping == JUMPING


@dims
@pytest.mark.parametrize("kernels", SETS)
def test_akincis_area_term_jumps_by_no_more_than_its_bound(dim, kernels):
    """Drops with pairs at r = h: moved by 1e-10 h, the acceleration changes by K eps |n_i - n_j| for each of them."""
    share = 2.0
    shape = SETS[kernels][1]
    grid = Discretisation(dim, "float64", 1.0, share, 0)
    position = Ball(radius=5.0).positions(grid)
    fluid = WeaklyCompressible(sound_speed=20.0, kernels=kernels, density="summation")
    others = {fluid.name: fluid}
    prepared = Akinci2013(surface_tension=1.0).prepare(grid, others) | fluid.shares(grid, others)
    found = {}
    for side in (-1, 1):
        case = Case(f"edge_{side}", dim, position * (1 + side * NEAR), spacing=1.0, support_radius=share)
        given = {"mass": np.full(len(position), fluid.particle_mass(grid)), **prepared}
        given |= {"candidates": None, "walls": None, "period": None}
        density = oracle(REGISTRY["sph.density"], Inputs(case, "float64").replaced(**given))["density"][0]
        given |= {"density": density, "smoothing": prepared["gradient_smoothing"]}
        inputs = Inputs(case, "float64").replaced(**given)
        normal = oracle(REGISTRY["surface_normal.color_gradient"], inputs)["surface_normal"][0]
        inputs = inputs.replaced(area_normal=normal)
        target = Target(REGISTRY["akinci_2013.tension"], "cpu", "float64", 1)
        start = {"acceleration": np.zeros((len(position), 3))}
        found[side] = (target.launch(target.varied(inputs), before=start)[1]["acceleration"], normal)
    (inside, normal), (outside, _) = found[-1], found[1]
    eps = float(prepared["area_term"].coefficient)
    apart = np.sqrt(((position[:, None] - position[None]) ** 2).sum(-1))
    edge = np.abs(apart - share) < 1e-6
    ratio = 2 * fluid.rest_density / (density[:, None] + density[None])
    expected = np.einsum("ij,ijc->ic", edge * eps * ratio, normal[None] - normal[:, None])
    jump = inside - outside
    assert jump == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())
    longest = steepest(shape, dim)
    assert 1.3 < longest < 1.6
    thin = fluid.rest_density / density.min()
    assert 1.2 < thin < 8
    assert np.linalg.norm(normal, axis=1).max() < 1.1 * longest * thin  # the lattice's sum for the integral
    pairs = np.linalg.norm((normal[None] - normal[:, None]) * (edge * ratio)[..., None], axis=-1)
    assert 0.1 * longest < pairs.max() < 2 * longest * thin**2
    largest = np.linalg.norm(inside, axis=1).max()
    assert 0.01 < eps * pairs.max() / largest < 1, f"one pair: {eps * pairs.max() / largest:.3f} of the largest"
