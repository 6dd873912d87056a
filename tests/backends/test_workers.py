"""Kernels are compiled by processes that are started anew, which end with the process that started them."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import numba
import numpy as np
import pytest

from refsim.backends import workers
from refsim.backends.compile import kernel
from refsim.backends.parallel_compile import launched_by
from refsim.backends.workers import Task, Worker

TINY = """
import os
from refsim.backends.compile import kernel
open(os.environ["SEEN"], "a").write(f"{os.getpid()}\\n")  # the processes that import this module

@kernel
def tripled(i, values):
    values[i] *= 3
"""
PROGRAM = """
import numba, numpy as np
from refsim.backends.workers import STORED, Task, Worker
from tiny import tripled
values, program = np.ones(5), tripled.on("cpu")
worker = Worker()
assert worker.store(Task.of(program, (numba.typeof(values),))) == STORED
tripled(values)
print(values[4], sum(program.stats.cache_hits.values()))
"""
SCRIPT = """
import numba, numpy as np
from refsim.backends.compile import kernel
from refsim.backends.workers import Task
@kernel
def doubled(i, values):
    values[i] *= 2
print(Task.of(doubled.on("cpu"), (numba.typeof(np.ones(5)),)))
"""


@pytest.fixture
def environment(tmp_path):
    (tmp_path / "tiny.py").write_text(TINY)
    root = str(pathlib.Path(workers.__file__).parents[2])
    return dict(
        os.environ, PYTHONPATH=os.pathsep.join([str(tmp_path), root]), SEEN=str(tmp_path / "seen"),
        REFSIM_CACHE_DIR=str(tmp_path / "cache"),
    )  # fmt: skip


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def gone(process, seconds=20):
    end = time.monotonic() + seconds
    while alive(process) and time.monotonic() < end:
        time.sleep(0.05)
    return not alive(process)


def test_another_process_compiles_a_kernel_and_ends_with_this_one(environment):
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["3.0", "1"], done.stderr  # the kernel came out of the cache
    assert done.stderr == ""
    own, other = map(int, pathlib.Path(environment["SEEN"]).read_text().split())
    assert own != other
    assert gone(other)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_one_that_started_it(environment, number):
    waiting = PROGRAM + "print('ready', flush=True)\nimport time\ntime.sleep(60)\n"
    process = subprocess.Popen(
        [sys.executable, "-c", waiting], env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    )
    with process:
        assert any("ready" in line for line in process.stdout)
        process.send_signal(number)
        assert process.wait(20) != 0
    assert all(map(gone, map(int, pathlib.Path(environment["SEEN"]).read_text().split())))


def test_what_no_other_process_can_import_is_no_task(environment):
    script = pathlib.Path(environment["SEEN"]).with_name("script.py")
    script.write_text(SCRIPT)
    done = subprocess.run([sys.executable, script], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["None"], done.stderr


def test_a_process_that_is_lost_is_noticed_and_a_closed_one_waited_for():
    worker = Worker()
    worker.process.kill()
    assert not worker.store(Task("refsim.sph.kernels", "state", b""))
    worker.close()
    assert worker.process.returncode is not None
    assert not worker.store(Task("refsim.sph.kernels", "state", b""))


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_a_host_function_tells_what_it_launches_and_changes_nothing():
    @kernel
    def doubled(i, values):
        values[i] *= 2

    @kernel
    def added(i, values, total):
        total[i] += values[i]

    def driver(values, total, number):
        doubled(values)
        values[0] = 9
        while total[0] > number:  # of arrays that no kernel has filled
            added(values, total)
            total[0] = 0
        added(values, total)

    values, total = np.ones(200, np.float32), np.ones(200)
    calls = launched_by(driver, (values, total, 0.5))
    assert [len(arguments) for _, arguments in calls] == [1, 2, 2]
    assert calls[0][0] is doubled.on("cpu")
    assert calls[1][0] is added.on("cpu")
    assert all(a.dtype == b.dtype for a, b in zip(calls[1][1], (values, total)))
    assert (values == 1).all()
    assert (total == 1).all()
    assert launched_by(driver, (values, total, object())) == []
    driver(values, total, 0.5)
    assert values[1] == 2
