"""Micro-benchmarks of every kernel: `pytest tests/ladder/bench_kernels.py -o addopts=`; not part of the test run.

Each registered operation runs on the contract's large case (3,000 particles with walls), in both dtypes, on every
backend that works here. `--benchmark-json FILE` keeps the numbers, `-k cuda` or `-k sph` picks some of them.
"""

import functools

import pytest

from refsim import contract
from refsim.backends.arrays import choose, unavailable
from refsim.core import cases
from refsim.core.operation import REGISTRY

CASE = "large"


@functools.cache
def bound(name, backend, dtype):
    """(call without arguments, wait until it has run) of one operation."""
    cases.discover()
    operation, place = REGISTRY[name], choose(backend)
    values = contract.bindings(operation, backend, dtype, CASE)
    return operation.bind(backend, values.__getitem__), place.synchronize


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", ["numpy", "cpu", "cuda"])
@pytest.mark.parametrize("name", REGISTRY)
def test_kernel(benchmark, name, backend, dtype):
    reason = unavailable(backend)
    if reason:
        pytest.skip(reason)
    call, wait = bound(name, backend, dtype)

    def run():
        call()
        wait()

    benchmark.pedantic(run, rounds=1 if backend == "numpy" else 7, warmup_rounds=0 if backend == "numpy" else 1)
