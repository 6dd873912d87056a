"""What a melting step costs on a GPU: stage by stage, each stage as a CUDA graph of its own, and beside the CPU."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from refsim import Scene, Simulation
from refsim.backends import runtime
from validation.experiments.melting.runs import grouped
from validation.experiments.melting.scene import made, scene_of, shared_tank
from validation.results import Result
from validation.running import Context, stage_seconds

WARM, STEPS = 30, 200  # steps before the clock runs, and under it


def clock() -> tuple[Callable[[], Any], Callable[[Any, Any], float]]:
    """(mark, seconds between two marks) on the device; on the host in the simulator."""
    if runtime.simulated():
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
    """Device seconds of every operation of a step, each timed alone; `rebuilt` is the share of steps with a new list.

    Fields are put back after each, so that all see the same state.
    """
    from refsim.backends import device

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
    simulation.lists.policy.invalidate()
    simulation.lists.update()
    simulation.backend.synchronize()
    found["neighbours"] = rebuilt * (time.perf_counter() - began)
    return found


def list_seconds(taken: dict[str, list[float]], alone: float) -> float:
    """Seconds a step for new lists: what steps with one take beyond the others; `alone` where one kind is missing."""
    plain, renewed = taken["step"], taken["step with a new list"]
    if not plain or not renewed:
        return alone
    return len(renewed) / (len(plain) + len(renewed)) * max(float(np.median(renewed) - np.median(plain)), 0.0)


def scene_named(name: str, size: float) -> Scene:
    """A figure's scene, or "million": a tank of 999,702 particles at size 1, a third of them solid."""
    if name == "million":
        return made(shared_tank("figure_6", 2.55 * size, 1 / 3), name)
    return scene_of(name, size)


def on_gpu(context: Context, figure: str, size: float, warm: int = WARM, count: int = STEPS) -> Result:
    """Seconds a step on the GPU: all of it, as one graph, with a new neighbour list, and by the paper's stages."""
    simulation = context.simulation(scene_named(figure, size), "cuda")
    taken = steps(simulation, warm, count)
    context.progress(0.7)
    renewed = len(taken["step with a new list"]) / count
    stage = stages(simulation, renewed)
    stage["neighbours"] = list_seconds(taken, stage["neighbours"])
    bodies = int(np.diff(simulation.plan.grid.solids.lattice.first).sum())
    return Result(
        {
            "figure": figure, "liquid": simulation.count - bodies, "solid": bodies,
            "seconds": sum(map(sum, taken.values())) / count, "renewed": renewed,
            "one_graph": float(np.median(taken["step"])) if taken["step"] else float("nan"),
            "with_list": float(np.median(taken["step with a new list"])) if renewed else float("nan"),
            "stages": grouped(stage), "operations": stage, "step": simulation.plan.scene.step,
            "solid_left": int((simulation.field("phase") != 0).sum()),
        }
    )  # fmt: skip


def beside_cpu(context: Context, figure: str, size: float, threads: int) -> Result:
    """Seconds of each of the paper's stages on the GPU and on so many threads of the CPU."""
    scene = scene_of(figure, size)
    on_gpu = context.simulation(scene, "cuda")
    taken = steps(on_gpu, WARM, STEPS)
    stage = stages(on_gpu, len(taken["step with a new list"]) / STEPS)
    gpu = grouped(stage | {"neighbours": list_seconds(taken, stage["neighbours"])})
    on_cpu = context.simulation(scene, "cpu", threads)
    for _ in range(WARM):
        on_cpu.step()
    on_cpu.timings.stages.clear()
    for _ in range(20):
        on_cpu.step()
    cpu = grouped({name: seconds / 20 for name, seconds in stage_seconds(on_cpu).items()})
    seconds = sum(map(sum, taken.values())) / STEPS
    return Result({"gpu": gpu, "cpu": cpu, "seconds": seconds, "step": scene.step, "particles": on_gpu.count})
