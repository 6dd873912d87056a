"""Benchmarks with pytest-benchmark: `pytest tests/times/bench_*.py --benchmark-json FILE`; not part of the test run.

Each states in `extra_info` the page, the backend and the name of its reading; `python -m validation times FILE` stores
the readings and makes the pages. Without a GPU those on `cuda` are skipped; in Numba's CUDA simulator they are tiny.
"""

import math
import time

import pytest

from refsim.backends import runtime
from refsim.backends.arrays import unavailable

READING = 0.05  # [s] that one reading lasts, or MOST calls
MOST = 100  # so that particles are where they were


def pytest_addoption(parser):
    parser.addoption("--particles", type=int, default=3000, help="of a kernel's benchmark")
    parser.addoption("--edge", type=int, default=79, help="particles along the edge of a system's cube")
    parser.addoption("--tiny", action="store_true", help="tens of particles and two readings, to try the benchmarks")


def pytest_benchmark_update_machine_info(config, machine_info):
    """Words of the processor and the device, and no name of the machine."""
    from validation.reading import environment

    found = environment(None, "cpu" if unavailable("cuda") or runtime.simulated() else "cuda")
    machine_info.clear()
    machine_info |= {name: found[name] for name in ("processor", "cores", "device")}


@pytest.fixture
def tiny(request):
    return request.config.getoption("--tiny") or runtime.simulated()


@pytest.fixture
def reading(benchmark, request, tiny):
    """Times a call: `reading(page, backend, name, call, warm, rounds, **more)`; a reading lasts READING, or MOST calls.

    Skips where the backend is missing.
    """

    def timed(page, backend, name, call, warm=10, rounds=15, iterations=None, **more):
        benchmark.extra_info |= {"page": page, "backend": backend, "name": name, **more}
        for _ in range(1 if tiny else warm):
            call()
        if iterations is None:
            began = time.perf_counter()
            call()
            iterations = min(MOST, math.ceil(READING / (time.perf_counter() - began)))
        benchmark.pedantic(call, rounds=min(2, rounds) if tiny else rounds, iterations=1 if tiny else iterations)

    return timed


@pytest.fixture(autouse=True)
def there(request):
    """Skips what runs on a backend that this machine lacks."""
    reason = unavailable(request.node.callspec.params.get("backend", "cuda"))
    if reason:
        pytest.skip(reason)
