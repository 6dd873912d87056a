"""Times: the least work of a kernel, scenes that are timed, benchmarks from end to end, the store and the pages."""

import itertools
import os
import subprocess
import sys

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
@pytest.mark.slow
def test_benchmarks_become_stored_times(tmp_path):
    """Of every kind, on the CPU and in the CUDA simulator, with kernels that run as Python."""
    file, names = tmp_path / "times.json", ("effects", "scaling", "kernels", "device")
    chosen = "sph-0-cpu or (test_steps and Dong) or (sph.density and float32 and not cuda)"
    chosen += " or copy or arithmetic or (test_kernel and 60k) or 60k-jiang_zhu or sph-0-cuda"
    words = [*(f"tests/times/bench_{name}.py" for name in names), "--edge", "3", "--particles", "50", "-k", chosen]
    command = [sys.executable, "-m", "pytest", "-q", "-n", "0", "--tiny", "--benchmark-json", str(file), *words]
    own = {name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")}
    own |= {"PYTHONPATH": f"{times.ROOT}{os.pathsep}{times.ROOT / 'tests'}"}
    own |= {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run(command, cwd=times.ROOT, env=own, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-3000:]
    assert "tests/times" not in file.read_text().partition('"benchmarks"')[0], "the machine has its words only"
    found = times.read(file)
    assert set(found) == {"effects cpu", "scaling cpu", "effects cuda", "device cuda"}
    (one,) = found["effects cpu"]["readings"].values()
    assert one["particles"] == 27
    assert min(one["seconds"]) > 0
    cores = len(os.sched_getaffinity(0))
    assert len(found["scaling cpu"]["readings"]) == sum(count <= cores for count in (1, 2, 4, 8, 16, 32))
    assert "| Dong | 27 |" in "\n".join(times.scaling_table(found))
    there = found["device cuda"]["readings"]
    assert set(there) >= {"copy", "arithmetic", "60k jiang_zhu", "60k list"}
    assert set(there) >= {f"60k {kernel}" for kernel in limits.STEP_KERNELS}
    assert there["60k density"]["particles"] == 27
    # In the cube of 3^3 within 2 d, without pairs at 2 d exactly: 3, 5 or more of 26 on corners, edges, faces, inside.
    assert 12 < there["60k density"]["neighbours"] <= there["60k density"]["entries"]
    assert there["60k density"]["neighbours"] < 26
    assert found["effects cuda"]["readings"]["sph: liquid"]["kernels"] == 12


def test_the_page_is_what_the_command_makes():
    assert times.page(times.stored()) == times.PAGE.read_text(), "python -m validation times"
