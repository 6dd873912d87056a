"""A step of each scene of the ladders, to which effects are added one by one (docs/study.md)."""

from contextlib import contextmanager

import pytest

from refsim import Simulation
from refsim.backends.compile import CudaKernel
from validation import timed

RUNGS = [(name, k) for name, ladder in timed.ladders().items() for k in range(len(ladder.rungs))]
THREADS = 2


@contextmanager
def counted_kernels():
    """Names of the CUDA kernels that are launched meanwhile."""
    names, launch = [], CudaKernel.__call__

    def counting(self, *arguments):
        names.append(self.__name__)
        launch(self, *arguments)

    CudaKernel.__call__ = counting
    try:
        yield names
    finally:
        CudaKernel.__call__ = launch


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
@pytest.mark.parametrize("name, number", RUNGS)
def test_step(reading, benchmark, tiny, name, number, backend):
    rung = timed.ladders(tiny)[name].rungs[number]
    simulation = Simulation(rung.scene, backend, THREADS if backend == "cpu" else None)
    more = {"threads": THREADS} if backend == "cpu" else {}
    reading("effects", backend, f"{name}: {rung.words}", simulation.step, particles=simulation.count, **more)
    if backend == "cuda":
        with counted_kernels() as kernels:
            operations = timed.launched(simulation)
        benchmark.extra_info["kernels"] = len(kernels)
    else:
        operations = timed.launched(simulation)
    assert timed.differences(simulation, operations) == []
