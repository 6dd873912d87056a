"""Inputs that the contract makes of a case, its bounds, and a comparison of runs, in numbers."""

import functools
import pathlib

import numpy as np
import pytest

from refsim import simulate
from refsim.contract import Target
from refsim.contract.answers import CLOUDS
from refsim.contract.bounds import Bounds, edge_terms, oracle
from refsim.contract.properties import CONSERVED, Usual, descriptions, force_bound, on_grid, total
from refsim.contract.whole_runs import Measure, compare, sensitivities
from refsim.core.operation import REGISTRY
from refsim.scene.files import parse_scene

FIELDS = ("position", "velocity", "mass", "pressure")


@functools.cache
def target_of(operation, variant=0):
    return Target(REGISTRY[operation], "numpy", "float64", variant, seed=1, dims=(2, 3))


def told(inputs):
    walls = inputs["walls"]
    return [inputs[name] for name in FIELDS], None if walls is None else walls.position


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("variant", [0, 2])
def test_other_descriptions_of_a_cloud_are_as_ever(dim, variant, recorded):
    """Moved, turned, reordered; each brings an answer back to the first rows and axes."""
    usual = Usual(target := target_of("sph.momentum", variant), on_grid(target, CLOUDS[dim]))
    found = {"itself": told(usual.inputs)}
    for name, other in descriptions(usual).items():
        inputs, back = other()
        found[name] = told(inputs), back(np.arange(3.0 * len(inputs["position"])).reshape(-1, 3))
    recorded(found)


@pytest.mark.parametrize("dim", [2, 3])
def test_totals_and_their_bounds_are_sums_over_particles(dim, recorded):
    """Against loops over particles; a common velocity changes nothing else, and one particle moves alone."""
    target = target_of("sph.momentum", 2)
    inputs = on_grid(target, CLOUDS[dim])
    bound = force_bound(target, inputs)
    a = np.random.default_rng(dim).normal(size=(len(bound), 3))
    m, x, v = (np.asarray(inputs[name], float) for name in ("mass", "position", "velocity"))
    middle = sum(x) / len(x)
    force = sum(m[i] * a[i] for i in range(len(m)))
    torque = sum(np.cross(x[i] - middle, m[i] * a[i]) for i in range(len(m)))
    power = sum(m[i] * a[i] @ v[i] for i in range(len(m)))
    arms = [np.hypot(np.hypot(*(x[i] - middle)[:2]), (x[i] - middle)[2]) for i in range(len(m))]
    assert total("linear_momentum", inputs, a, bound) == pytest.approx((np.sqrt(force @ force), sum(bound)))
    expected = np.sqrt(torque @ torque), sum(b * arm for b, arm in zip(bound, arms))
    assert total("angular_momentum", inputs, a, bound) == pytest.approx(expected)
    assert total("dissipation", inputs, a, bound) == pytest.approx((power, 0.0))
    recorded({"bound": bound} | {name: [told(g) for g in moves(inputs)] for name, (moves, _) in CONSERVED.items()})


@pytest.mark.parametrize("variant", [0, 2])
@pytest.mark.parametrize("operation", ["sph.density", "sph.momentum"])
def test_bounds_are_as_ever(operation, variant, recorded):
    """The plain one for all particles and some, once and twice, from zero and from a start; the terms at r = h."""
    made, found = REGISTRY[operation], {}
    for dim in (2, 3):
        inputs = on_grid(target_of(operation, variant), CLOUDS[dim])
        for rows in (None, np.array([3, 0, 7])):
            answer = oracle(made, inputs, rows)
            found[f"edge {dim} {rows is None}"] = edge_terms(made, inputs, rows)
            for share in (1.0, 2.0):
                bounds = Bounds(made, inputs, rows, share)
                for name, (value, scale) in answer.items():
                    start = np.ones_like(value)
                    plain = next(bounds.growing(name, value, scale, start))
                    closed = next(bounds.growing(name, value, None, start))
                    found[f"{name} {dim} {rows is None} {share}"] = plain, closed, bounds.near()
                    bounds.conditioned, bounds.jumps = lambda n=name: {n: 5.0}, lambda n=name: {n: 3.0}
                    _, more, most = bounds.growing(name, value, scale, start)
                    assert more - plain == pytest.approx(5.0 * share * bounds.factor, rel=1e-3)
                    assert most - more == pytest.approx(3.0 * share)
    recorded(found)


DAM = pathlib.Path(__file__).with_name("dam_break.toml").read_text()
SCENE = DAM.replace("cells = [6, 8, 1]", "cells = [5, 6, 1]\nvelocity = [0.3, 0.1, 0.0]")


def test_a_comparison_of_runs_is_as_ever(tmp_path, recorded):
    """A run with more viscosity, by all bands, by given ones and by chaos alone, and what it would have noticed."""
    scene, found = parse_scene(SCENE, "scene.toml"), {}
    other = parse_scene(
        SCENE.replace("viscosity = 1.0", "viscosity = 1.4").replace("0.3, 0.1", "0.31, 0.1"), "other.toml"
    )
    simulate(other, 0.012, backend="numpy", output=tmp_path / "out", every=0.003, progress=False)
    for name, given in {
        "all": {}, "earlier": {"at": 0.0061}, "given": {"allowed": {"centre x": 1e-3}, "within": 5.0},
        "alone": {"chaos_only": True},
    }.items():  # fmt: skip
        compared = compare(scene, tmp_path / "out", backend="numpy", **given)
        rows = [(m.time, m.theirs, m.ours[0], m.resolution, m.verdict == "holds", m.holds) for m in compared.measures]
        curves = {key: [float(f"{v:.5g}") for v in row] for key, row in compared.curves.items()}
        found[name] = rows, compared.times, curves, compared.coarser, compared.behind
        found[name] += ([m.chaos for m in compared.measures if m.name in ("particles", "mass", "centre x")][:2],)
    bands = dict.fromkeys((m.name for m in compared.measures), 1e-3)
    every = list(sensitivities(scene, compare(scene, tmp_path / "out", backend="numpy", allowed=bands), "numpy"))
    found["noticed"] = [s.error for s in every]
    recorded(found)


def test_a_measure_holds_by_either_band():
    cases = ((1.9, 1.0, 0.0, "FAILS"), (1.9, 0.5, 1.5, "within resolution"), (1.9, 1.5, 0.1, "holds"))
    for theirs, chaos, resolution, verdict in cases:
        one = Measure("a", "m", 0.1, theirs, (0.0, 1.0, 0.4), chaos, resolution)
        assert (one.difference, one.allowed) == pytest.approx((1.4, max(chaos, resolution)))
        assert (one.verdict, one.holds) == (verdict, verdict != "FAILS")
    assert Measure("a", "m", 0.1, 1.5, (0.0, 1.0), 1.0).verdict == "holds"
