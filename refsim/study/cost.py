"""Seconds of a run before it is run: those of ten steps of the scene itself, times the steps to its end.

The scene is started and compiled, its neighbour list is built, and then ten steps are timed. The run has as many steps
to its end as the length of the tenth one, which the scene's step limits set. List builds after the first one and frames
are not counted.
"""

import math
import time
from dataclasses import dataclass

from refsim.engine.simulation import Simulation
from refsim.scene.plan import Plan
from refsim.study.memory import bytes_of

WARM = 2  # steps before, which build the list and compile
STEPS = 10


@dataclass(frozen=True)
class Cost:
    """What a run takes on a backend, with one thread of a CPU.

    bytes   of fields, lists and walls, from the plan
    start   wall seconds in which the scene was started, its kernels compiled or loaded
    each    processor seconds of a step
    ratio   wall seconds over processor seconds of the timed steps: above 1 on a GPU, and beside other programs
    steps   to the scene's end, of the `length` [s] of the last timed one
    """

    backend: str
    particles: int
    bytes: int
    start: float
    each: float
    ratio: float
    steps: int
    length: float

    @property
    def processor(self) -> float:
        """Processor seconds of all steps."""
        return self.steps * self.each

    @property
    def wall(self) -> float:
        """Wall seconds of all steps on a machine that is as busy as it was."""
        return self.ratio * self.processor


def measured(plan: Plan, backend: str = "cpu") -> Cost:
    """What a run of the plan's scene to its end takes.

    Raises InputError where the scene cannot be run on this backend, and RunStopped where it stops in its first steps.
    """
    began = time.perf_counter()
    simulation = Simulation(plan, backend, 1)
    _steps(simulation, WARM)
    start, before = time.perf_counter() - began, sum(simulation.timings.first_calls.values())
    processor, wall = time.process_time(), time.perf_counter()
    _steps(simulation, STEPS)
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    compiled = (sum(simulation.timings.first_calls.values()) - before) / wall  # its share: stages that are first called
    assert simulation.last is not None
    length = simulation.last.length
    return Cost(
        backend, plan.grid.count, bytes_of(plan, backend)["total"], start, (1 - compiled) * processor / STEPS,
        wall / processor, math.ceil(plan.scene.end_time / length * (1 - 1e-9)), length,
    )  # fmt: skip


def _steps(simulation: Simulation, count: int) -> None:
    for _ in range(count):
        simulation.step()
    simulation.backend.synchronize()
