"""Times: the least work of a kernel, scenes that are timed, benchmarks from end to end, the store and the pages."""

import itertools
import os
import subprocess
import sys

import numpy as np
import pytest

from refsim import make_plan
from validation import limits, timed, times


# Scenes
@pytest.mark.parametrize("name", timed.ladders())
def test_a_ladder_only_adds(name):
    """No rung launches less, or holds less, than the one before it; the small scenes have the same effects."""

    def of(rungs):
        plans = [make_plan(rung.scene) for rung in rungs]
        return [(len(timed.step_launches(plan, "cuda")), sum(plan.field_bytes().values())) for plan in plans]

    rungs = of(timed.ladders()[name].rungs)
    for before, after in itertools.pairwise(rungs):
        assert after[0] >= before[0]
        assert after[1] >= before[1]
    assert rungs[-1][1] > rungs[0][1]
    assert of(timed.ladders(True)[name].rungs) == rungs


# Benchmarks, store, pages
def benchmarks(folder, words, **environment):
    """What `pytest tests/times/...` with these words gives, as it is stored."""
    file = folder / "times.json"
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--tiny", "--benchmark-json", str(file), *words]
    around = os.environ | {"PYTHONPATH": str(times.ROOT)} | environment
    around = {name: value for name, value in around.items() if not name.startswith("PYTEST_")}
    done = subprocess.run(command, cwd=times.ROOT, env=around, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "tests/times" not in file.read_text().partition('"benchmarks"')[0], "the machine has its words only"
    return times.read(file)


def test_benchmarks_become_stored_times(tmp_path):
    words = ["bench_effects.py", "bench_scaling.py", "bench_kernels.py", "bench_device.py"]
    chosen = "sph-0-cpu or (test_steps and Dong) or (sph.density and float32 and not cuda) or test_surface"
    given = [f"tests/times/{name}" for name in words]
    found = benchmarks(tmp_path, [*given, "--edge", "4", "--particles", "50", "-k", chosen])
    assert set(found) == {"effects cpu", "scaling cpu", "device cpu"}
    surface = found["device cpu"]["readings"]["surface in turns"]
    assert surface["ratio"] == pytest.approx(np.median(surface["own"]) / np.median(surface["plain"]), rel=2e-3)
    (own,) = found["effects cpu"]["readings"].values()
    assert own["particles"] == 27
    assert min(own["seconds"]) > 0
    cores = len(os.sched_getaffinity(0))
    assert len(found["scaling cpu"]["readings"]) == sum(count <= cores for count in (1, 2, 4, 8, 16, 32))
    assert "| Dong | 64 |" in "\n".join(times.scaling_table(found))


def test_benchmarks_of_a_gpu_run_in_the_simulator(tmp_path):
    simulated = {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    chosen = "copy or arithmetic or (test_kernel and 60k) or table or 60k-jiang_zhu or sph-0-cuda"
    given = ["tests/times/bench_device.py", "tests/times/bench_effects.py", "-k", chosen]
    environment = simulated | {"PYTHONPATH": f"{times.ROOT}{os.pathsep}{times.ROOT / 'tests'}"}
    found = benchmarks(tmp_path, given, **environment)
    own = found["device cuda"]["readings"]
    assert set(own) >= {"copy", "arithmetic", "table", "60k jiang_zhu", "60k list"}
    assert set(own) >= {f"60k {kernel}" for kernel in limits.STEP_KERNELS}
    assert own["60k density"]["particles"] == 27
    # In the cube of 3^3 within 2 d, without pairs at 2 d exactly: 3, 5 or more of 26 on corners, edges, faces, inside.
    assert 12 < own["60k density"]["neighbours"] <= own["60k density"]["entries"]
    assert own["60k density"]["neighbours"] < 26
    assert found["effects cuda"]["readings"]["sph: liquid"]["kernels"] == 12


def test_the_page_is_what_the_command_makes():
    assert times.page(times.stored()) == times.PAGE.read_text(), "python -m validation times"
