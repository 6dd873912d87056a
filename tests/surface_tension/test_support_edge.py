"""Tension at the edge of the support: which terms do not vanish at r = h, and how far they jump there."""

import numpy as np

from refsim.contract import Inputs, Target
from refsim.contract.bounds import oracle
from refsim.core.cases import Case
from refsim.core.operation import REGISTRY

FOLDER = "refsim.surface_tension."
JUMPING = {f"{model}.tension{p}" for model in ("akinci_2013", "jiang_zhu_2023") for p in ("", ":fused", ":central")}
JUMPING |= {"jiang_zhu_2023.area", "normal_difference_2014.tension"}
NEAR = 1e-10  # of h


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
