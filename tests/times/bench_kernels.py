"""Every registered operation, in both dtypes, on every backend that works here: the contract's large case.

`--particles N` gives it another size, `-k cuda` or `-k sph` picks some.
"""

import functools

import pytest

from refsim import contract
from refsim.backends.arrays import choose
from refsim.core import cases
from refsim.core.operation import REGISTRY

CASE = "large"


@functools.cache
def bound(name, backend, dtype, particles):
    """(call without arguments, wait until it has run) of one operation."""
    cases.discover()
    position = cases.cloud(CASE, particles, 3)
    cases.CASES[CASE] = lambda: cases.Case(CASE, 3, position, wall_position=cases.floor_below(position, 3, 0.1))
    operation, place = REGISTRY[name], choose(backend)
    values = contract.bindings(operation, backend, dtype, CASE)
    if backend == "numpy":  # the reference, which takes no outputs
        return functools.partial(operation.program(backend), **values), place.synchronize
    return operation.bind(backend, values.__getitem__), place.synchronize


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("backend", ["numpy", "cpu", "cuda"])
@pytest.mark.parametrize("name", REGISTRY)
def test_kernel(reading, request, name, backend, dtype):
    call, wait = bound(name, backend, dtype, request.config.getoption("--particles"))

    def run():
        call()
        wait()

    few = {"warm": 0, "rounds": 1, "iterations": 1} if backend == "numpy" else {"rounds": 7, "iterations": 1}
    reading("kernels", backend, f"{name}, {dtype}", run, **few)
