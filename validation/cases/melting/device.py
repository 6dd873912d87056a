"""What a melting step costs on a GPU: stage by stage, each stage as a CUDA graph of its own, and beside the CPU."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim import Simulation, backend
from validation.cases.melting.runs import grouped
from validation.cases.melting.scene import scene_of
from validation.results import Result
from validation.running import Context, stage_seconds

WARM, STEPS = 30, 200  # steps before the clock runs, and under it


def clock() -> tuple[Callable[[], Any], Callable[[Any, Any], float]]:
    """(mark, seconds between two marks) on the device; on the host in the simulator."""
    if backend.simulated():
        return time.perf_counter, lambda a, b: b - a
    import cupy

    def mark() -> Any:
        event = cupy.cuda.Event()
        event.record()
        return event

    def between(a: Any, b: Any) -> float:
        b.synchronize()
        return 1e-3 * float(cupy.cuda.get_elapsed_time(a, b))

    return mark, between


def steps(simulation: Simulation, warm: int, count: int) -> dict[str, list[float]]:
    """Wall seconds of steps, those with a new neighbour list apart; every step waits for the device."""
    for _ in range(warm):
        simulation.step()
    taken: dict[str, list[float]] = {"step": [], "step with a new list": []}
    assert simulation.search is not None
    for _ in range(count):
        built, began = simulation.search.log.rebuilds, time.perf_counter()
        simulation.step()
        kind = "step with a new list" if simulation.search.log.rebuilds > built else "step"
        taken[kind].append(time.perf_counter() - began)
    return taken


def stages(simulation: Simulation, rebuilt: float, repeats: int = 20) -> dict[str, float]:
    """Device seconds of every operation of a step, by itself; `rebuilt` is the share of steps with a new list.

    Fields are put back after each, so that all see the same state.
    """
    from refsim import device

    mark, between = clock()
    kept = {name: np.array(simulation.backend.host(values)) for name, values in simulation.fields.items()}
    found: dict[str, float] = {}
    forces = [(name, call) for name, rare, call in simulation.force_calls if not rare]
    motion = [("sph.extremes", simulation.extremes_call), *simulation.motion_calls]
    for name, call in [*simulation.begin_calls, *forces, *motion]:
        repeated = device.Recorded(call)
        repeated()  # compiles
        repeated()  # records
        first = mark()
        for _ in range(repeats):
            repeated()
        last = mark()
        simulation.backend.synchronize()
        found[name] = between(first, last) / repeats
        for field, values in kept.items():
            simulation.backend.assign(simulation.fields[field], values)
    began = time.perf_counter()
    simulation._squared_way = np.inf
    simulation._update_list()
    simulation.backend.synchronize()
    found["neighbours"] = rebuilt * (time.perf_counter() - began)
    return found


def beside_cpu(context: Context, figure: str, size: float, threads: int) -> Result:
    """Seconds of each of the paper's stages on the GPU and on so many threads of the CPU."""
    scene = scene_of(figure, size, largest_number=0.2)
    on_gpu = context.simulation(scene, "cuda")
    taken = steps(on_gpu, WARM, STEPS)
    gpu = grouped(stages(on_gpu, len(taken["step with a new list"]) / STEPS))
    on_cpu = context.simulation(scene, "cpu", threads)
    for _ in range(WARM):
        on_cpu.step()
    on_cpu.timings.stages.clear()
    for _ in range(20):
        on_cpu.step()
    cpu = grouped({name: seconds / 20 for name, seconds in stage_seconds(on_cpu).items()})
    seconds = sum(map(sum, taken.values())) / STEPS
    return Result({"gpu": gpu, "cpu": cpu, "seconds": seconds, "step": scene.step, "particles": on_gpu.count})
