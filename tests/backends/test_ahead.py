"""Kernels are compiled before the first step, each once, and the run loads them from the cache."""

import json
import os
import pathlib
import subprocess
import sys

import pytest

import refsim

PROGRAM = """
import json, os
from refsim import Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.operation import REGISTRY
os.sched_getaffinity = lambda process: range(CORES)
told = []
def begun(kernels, processes):
    told.append([kernels, processes, 0])
    def after():
        told[-1][2] += 1
    return after
simulation = Simulation(
    Scene(spacing=0.1, support_radius=0.2, dim=2, step=1e-3, fluid=(Box(cells=(5, 4, 1)),),
          effects=(WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=0.1), Gravity(acceleration=(0.0, -9.81, 0.0)),
                   BoxWalls(lower=(0, 0, 0), upper=(1, 1, 1)))),
    "cpu", compiling=begun)
for _ in range(2):
    simulation.step()
programs = [REGISTRY[name].program("cpu") for name in ("sph.density", "sph.momentum", "sph.extremes", "sph.kick_drift")]
print(json.dumps([told, [[sum(p.stats.cache_hits.values()), sum(p.stats.cache_misses.values())] for p in programs]]))
"""


@pytest.fixture
def run(tmp_path):
    def with_cores(cores, cache):
        environment = dict(
            os.environ, REFSIM_CACHE_DIR=str(cache), PYTHONPATH=str(pathlib.Path(refsim.__file__).parents[1])
        )
        program = PROGRAM.replace("CORES", str(cores))
        done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout.splitlines()[-1])

    return with_cores


def test_kernels_are_stored_before_the_first_step_and_once(run, tmp_path):
    ((kernels, processes, after),), stats = run(2, tmp_path / "cache")
    assert kernels >= 8
    assert processes == 2
    assert after == kernels
    assert all(hits == 1 and misses == 0 for hits, misses in stats), "a kernel of a pass was compiled by the run itself"
    assert run(2, tmp_path / "cache")[0] == [], "something was compiled twice"


def test_one_core_compiles_as_the_run_comes_to_each_kernel(run, tmp_path):
    told, _ = run(1, tmp_path / "cache")
    assert told == []


def test_without_a_cache_nothing_is_compiled_ahead(run, tmp_path):
    (tmp_path / "file").touch()
    told, stats = run(2, tmp_path / "file")
    assert told == []
    assert all(hits == 0 for hits, _ in stats)
