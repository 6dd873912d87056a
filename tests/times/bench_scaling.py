"""Steps of each system on 1, 2, 4, ... threads, each on a core of its own (docs/study.md).

A scene is started once for all numbers of threads. A reading is three steps, before the first of which the neighbour
list is built anew. `--edge N` gives the cube another size.
"""

import functools
import os

import pytest

from refsim import Simulation
from tests.running import advanced
from validation import timed

THREADS = (1, 2, 4, 8, 16, 32)
STEPS = 3  # of a reading; a list serves about ten where liquid moves freely, one where solids melt
CORES = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def pin(cores):
    """Let all threads of this process run on these cores only, where the system can do that."""
    for thread in os.listdir("/proc/self/task") if hasattr(os, "sched_setaffinity") else ():
        try:
            os.sched_setaffinity(int(thread), cores)
        except ProcessLookupError:  # it has ended meanwhile
            continue


@functools.lru_cache(maxsize=1)
def started(system, edge):
    return Simulation(timed.systems(edge)[system](), "cpu", threads=min(len(CORES), max(THREADS)))


@pytest.fixture
def cores():
    yield CORES
    pin(CORES)


@pytest.mark.parametrize("backend", ["cpu"])
@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("system", timed.systems())
def test_steps(reading, request, cores, system, threads, backend):
    if threads > len(cores):
        pytest.skip(f"{len(cores)} cores")
    simulation = started(system, request.config.getoption("--edge"))

    def steps():
        if simulation.search is not None:
            simulation.lists.invalidate()
        advanced(simulation, STEPS)

    simulation.threads = threads
    pin(cores[:threads])
    more = {"particles": simulation.count, "steps": STEPS, "threads": threads}
    reading("scaling", backend, f"{system}, {threads}", steps, warm=1, rounds=7, iterations=1, **more)
