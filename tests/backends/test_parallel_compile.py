"""Kernels are compiled before the first step, each once, and the run loads them from the cache."""

import functools
import json

import pytest

import refsim
from tests.running import python

PROGRAM = """
import json, os
from refsim import Box, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.operation import REGISTRY
from refsim.sph import kernels
os.sched_getaffinity = lambda process: range(CORES)
told = []
def begun(kernels, processes):
    told.append([kernels, processes, 0])
    def after():
        told[-1][2] += 1
    return after
simulation = Simulation(
    Scene(spacing=0.1, support_radius=0.2, dim=2, step=1e-3, fluid=(Box(cells=(5, 4, 1)),),
          effects=EFFECTS), "cpu", compiling=begun)
for _ in range(2):
    simulation.step()
launched = {"sph.extremes": kernels.extremes.on("cpu"), "sph.kick_drift": kernels.kick_drift.on("cpu")}
programs = [launched.get(name) or REGISTRY[name].program("cpu") for name in NAMES]
print(json.dumps([told, [[sum(p.stats.cache_hits.values()), sum(p.stats.cache_misses.values())] for p in programs]]))
"""
FALL = "(Gravity(acceleration=(0.0, -9.81, 0.0)),)"
LIQUID = f"(WeaklyCompressible(sound_speed=20.0), *{FALL})"
NAMES = {FALL: ("sph.gravity", "sph.extremes", "sph.kick_drift")}  # every kernel of the run
NAMES[LIQUID] = ("sph.continuity", "sph.momentum", *NAMES[FALL])


@pytest.fixture
def run(tmp_path):
    def with_cores(cores, cache, effects=LIQUID):
        given = {"CORES": cores, "EFFECTS": effects, "NAMES": NAMES[effects]}
        program = functools.reduce(lambda text, name: text.replace(name, str(given[name])), given, PROGRAM)
        return json.loads(python("-c", program, REFSIM_CACHE_DIR=str(cache)).stdout.splitlines()[-1])

    return with_cores


def test_kernels_are_stored_before_the_first_step_and_once(run, tmp_path):
    ((kernels, processes, after),), stats = run(2, tmp_path / "cache")
    assert kernels >= 8
    assert (processes, after) == (2, kernels)
    assert all(hits == 1 and misses == 0 for hits, misses in stats), "a kernel of a pass was compiled by the run itself"
    assert run(2, tmp_path / "cache")[0] == [], "something was compiled twice"


def test_one_core_compiles_as_the_run_comes_to_each_kernel(run, tmp_path):
    told, stats = run(1, tmp_path / "cache", FALL)
    assert told == []
    assert all(hits + misses > 0 for hits, misses in stats), "the run has not come to each kernel"


@pytest.mark.parametrize(("effects", "kernels"), [
    (
        (refsim.ImplicitPressure(),),
        {"predict", "halve", "displace", "relax", "keep", "push", "count_missed", "block_boxes"},
    ),
    ((refsim.HeatConduction(),), {"weigh", "advance", "collect"}),
    ((refsim.HeatConduction(scheme="conjugate_gradient"),), {"weigh", "flow", "turn_chunk", "step_chunk", "add"}),
])  # fmt: skip
def test_kernels_inside_host_functions_are_among_those_compiled_ahead(monkeypatch, effects, kernels):
    from refsim.backends import parallel_compile

    class Seen(Exception):
        pass

    def seen(calls, begun):
        raise Seen({kernel.__name__ for kernel, _ in calls})

    monkeypatch.setattr(parallel_compile, "compile_ahead", seen)
    scene = refsim.Scene(
        spacing=0.1, support_radius=0.2, dim=3, fluid=(refsim.Box(cells=(4, 4, 4)),),
        effects=(refsim.WeaklyCompressible(sound_speed=20.0, density="summation"), *effects),
    )  # fmt: skip
    with pytest.raises(Seen) as names:
        refsim.Simulation(scene, "cpu")
    assert kernels <= names.value.args[0], kernels - names.value.args[0]
