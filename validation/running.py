"""Advancing simulations for experiments: progress, samples at set times, and what the stepping alone has cost."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from refsim import Plan, Scene, Simulation
from refsim.backends import arrays
from refsim.backends.arrays import Backend, choose, threads_of
from refsim.core.errors import InputError, RunStopped
from refsim.scene.plan import make_plan


@dataclass
class Context:
    """What a run is given beside its parameters: whom to tell the share done, and how many threads to use."""

    progress: Callable[[float], None] = lambda share: None
    threads: int | None = None
    started: list[Simulation] = field(default_factory=list)

    def simulation(self, scene: Scene | Plan, backend: str, threads: int | None = None) -> Simulation:
        """A simulation that the run has started."""
        made = Simulation(scene, backend=backend, threads=threads or self.threads)
        self.started.append(made)
        return made

    def gpu(self) -> bool:
        """Whether a simulation ran on a GPU."""
        return any(made.backend.name == "cuda" for made in self.started)


@contextmanager
def on_threads(backend: str, threads: int | None) -> Iterator[Backend]:
    """A backend whose CPU loops use so many threads, all by default, until the block ends."""
    there = choose(backend)
    with arrays.on_threads(threads_of(there, threads)):
        yield there


def advance(
    simulation: Simulation,
    times: Sequence[float],
    sample: Callable[[Simulation, float], None],
    context: Context,
    keep_on: Callable[[], bool] = lambda: True,
) -> float:
    """Step through `times` [s] and call `sample(simulation, wall)` at each; returns the wall seconds of stepping.

    A sample stands at the first step at or after its time. Sampling is not charged, and neither is the first call of
    each stage, which compiles or loads its kernel. Stops early where `keep_on` says no after a sample.
    """
    wall, last = 0.0, max(times[-1], 1e-300)
    for at in times:
        began, compiled, steps = time.perf_counter(), first_call_seconds(simulation), 0
        while simulation.time < at:
            simulation.step()
            steps += 1
            if steps % 16 == 0:
                context.progress(simulation.time / last)
        wall += time.perf_counter() - began - (first_call_seconds(simulation) - compiled)
        sample(simulation, wall)
        context.progress(simulation.time / last)
        if not keep_on():
            break
    return wall


def take_steps(simulation: Simulation, count: int) -> float:
    """Wall seconds of so many steps."""
    began = time.perf_counter()
    for _ in range(count):
        simulation.step()
    return time.perf_counter() - began


def until_stopped(
    simulation: Simulation, times: Sequence[float], sample: Callable[[Simulation, float], None], context: Context
) -> tuple[float, str]:
    """`advance`: its wall seconds, 0 for a run that stopped, and why and when it stopped or ""."""
    try:
        return advance(simulation, times, sample, context), ""
    except RunStopped as stop:
        return 0.0, f"{stop.reason} at {simulation.time:.3f} s"


def note(series: dict[str, list[Any]], row: Mapping[str, Any]) -> None:
    """One more entry of each series."""
    for name, value in row.items():
        series.setdefault(name, []).append(value)


def refusal(scene: Scene) -> str:
    """Why the scene is refused, in its one sentence; "" where it is not."""
    try:
        make_plan(scene)
    except InputError as error:
        return f"refused: {error}"
    return ""


def search_log(simulation: Simulation) -> dict[str, int]:
    """Rebuilds of the neighbour list and what its audit found; empty without a list."""
    if simulation.search is None:
        return {}
    log = simulation.search.log
    return {
        "rebuilds": log.rebuilds, "audited_rows": log.audited_rows, "missed_neighbours": log.missed_neighbours,
        "most_neighbours": log.most_neighbours,
    }  # fmt: skip


def stage_seconds(simulation: Simulation) -> dict[str, float]:
    """Wall seconds by stage, without each stage's first call."""
    return dict(simulation.timings.stages)


def first_call_seconds(simulation: Simulation) -> float:
    """Wall seconds of every stage's first call: compiling, or loading what was compiled before."""
    return float(sum(simulation.timings.first_calls.values()))


def momenta(simulation: Simulation) -> dict[str, Any]:
    """Momentum, angular momentum about the origin, kinetic energy, and the sums of moduli that they are read against.

    SI units; velocities are half a step behind the positions.
    """
    mass = simulation.field("mass").astype(float)[:, None]
    position, velocity = (simulation.field(name).astype(float) for name in ("position", "velocity"))
    speed = np.linalg.norm(velocity, axis=1)
    return {
        "momentum": (mass * velocity).sum(0),
        "angular_momentum": (mass * np.cross(position, velocity)).sum(0),
        "kinetic_energy": float(0.5 * (mass[:, 0] * speed**2).sum()),
        "momentum_scale": float((mass[:, 0] * speed).sum()),
        "angular_scale": float((mass[:, 0] * speed * np.linalg.norm(position, axis=1)).sum()),
    }


def run_to(simulation: Simulation, time: float) -> None:
    """Step until this time is reached."""
    while simulation.time < time:
        simulation.step()


def medians(function: Callable[[], Any], there: Backend, repeats: int) -> tuple[float, float]:
    """(median, median deviation) of wall seconds of a call, after one that compiles."""
    return median_and_mad(beside({"": function}, there, repeats)[""])


def beside(programs: Mapping[str, Callable[[], Any]], there: Backend, turns: int) -> dict[str, list[float]]:
    """Wall seconds of each call in each turn, after one call that compiles. In turns, because on shared cores the time
    of one program says little beside that of another a second later."""
    spent: dict[str, list[float]] = {name: [] for name in programs}
    for turn in range(turns + 1):
        for name, function in programs.items():
            began = time.perf_counter()
            function()
            there.synchronize()
            if turn:
                spent[name].append(time.perf_counter() - began)
    return spent


def median_and_mad(spent: list[float]) -> tuple[float, float]:
    """(median, median deviation)."""
    median = float(np.median(spent))
    return median, float(np.median(np.abs(np.array(spent) - median)))


class EnergyWatch:
    """Kinetic and potential energy over a run; `rise` is how far it ever came above the start's [J; J/m in 2D]."""

    def __init__(self, simulation: Simulation, gravity: float = 9.81) -> None:
        self.gravity, self.simulation = gravity, simulation
        self.start, self.rise = self.of(simulation), 0.0

    def of(self, simulation: Simulation) -> float:
        mass, height = (simulation.field(name).astype(float) for name in ("mass", "position"))
        return momenta(simulation)["kinetic_energy"] + self.gravity * float(mass @ height[:, 1])

    def __call__(self, simulation: Simulation) -> None:
        self.rise = max(self.rise, self.of(simulation) - self.start)

    def run(self, until: float) -> str:
        """Step and look every eighth time; why the run stopped, or ""."""
        try:
            while self.simulation.time < until:
                self.simulation.step()
                if self.simulation.steps % 8 == 0:
                    self(self.simulation)
        except RunStopped as stop:
            return f"stopped: {stop.reason}"
        return ""
