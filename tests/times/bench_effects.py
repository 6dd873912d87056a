"""A step of each scene of the ladders, to which effects are added one by one (docs/study.md)."""

import pytest

from refsim import Simulation
from refsim.backends.compile import CudaKernel
from validation import timed

RUNGS = [(name, k) for name, ladder in timed.ladders().items() for k in range(len(ladder.rungs))]
THREADS = 2


@pytest.mark.parametrize("backend", ["cpu", "cuda"])
@pytest.mark.parametrize("name, number", RUNGS)
def test_step(reading, benchmark, tiny, name, number, backend, monkeypatch):
    rung = timed.ladders(tiny)[name].rungs[number]
    simulation = Simulation(rung.scene, backend, THREADS if backend == "cpu" else None)
    more = {"threads": THREADS} if backend == "cpu" else {}
    reading("effects", backend, f"{name}: {rung.words}", simulation.step, particles=simulation.count, **more)
    kernels, launch = [], CudaKernel.__call__  # of a GPU, launched in a step
    monkeypatch.setattr(CudaKernel, "__call__", lambda of, *given: (kernels.append(of), launch(of, *given)))
    operations = timed.launched(simulation)
    benchmark.extra_info |= {"kernels": len(kernels)} if kernels else {}
    assert timed.differences(simulation, operations) == []
