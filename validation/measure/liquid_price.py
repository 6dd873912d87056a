"""What the liquid costs: steps of water at rest with each of its options over those of the papers' liquid, in turns,
and steps of what moves.

`python -m validation measure liquid_price` stores the seconds of a step in each turn, on a CPU those of the processor,
and prints medians, and medians and ranges of the ratios.
"""

import argparse
import json
import math
import statistics
import time
from typing import Any

from refsim import Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.writing import write_file
from validation.reading import environment
from validation.running import take_steps
from validation.timed import spinning_cube

TURNS, FALLEN = 12, 300  # turns; steps after which a column falls
STEPS = {"cpu": (14, 5), "cuda": (80, 40)}  # before the first turn, and of a turn
CELLS = {2: {"cpu": 128, "cuda": 720}, 3: {"cpu": 32, "cuda": 80}}  # particles along the edge, by dimensions
SOUND = 10 * math.sqrt(9.81)  # of a tank 1 m deep [m/s]
PAPERS: dict[str, Any] = {"density": "summation"}
# dimensions, support radius over the spacing, liquid; after the papers' liquid those that are compared with it
TANKS: dict[str, tuple[int, float, dict[str, Any]]] = {
    "the papers' liquid, h = 2.6 d": (3, 2.6, PAPERS),
    "without shifting": (3, 2.6, {"density": "continuity"}),
    "the default": (3, 2.6, {}),
    "the papers' liquid, h = 3.2 d": (3, 3.2, PAPERS),
    "the default, h = 3.2 d": (3, 3.2, {}),
    "the papers' liquid, 2D, h = 2.6 d": (2, 2.6, PAPERS),
    "the default, 2D": (2, 2.6, {}),
}


def water(dim: int, h: float, liquid: dict[str, Any], cells: int, wide: float = 1.0) -> Scene:
    """A square or a cube of water, 1 m deep, in a box 2 m high."""
    d, flat = 1 / cells, dim == 2
    effects = (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1000 * SOUND * h * d / 125, **liquid),
        Gravity(acceleration=(0.0, -9.81, 0.0)),
        BoxWalls(lower=(0.0, 0.0, 0.0), upper=(wide, 2.0, 0.0 if flat else 1.0)),
    )  # fmt: skip
    fluid = (Box(cells=(cells, cells, 1 if flat else cells)),)
    return Scene(dim=2 if flat else 3, spacing=d, support_radius=h * d, fluid=fluid, effects=effects, dtype="float32")


def measured(backend: str, threads: int | None) -> dict[str, list[float]]:
    """Seconds of a step in each turn."""
    before, steps = STEPS[backend]
    scenes = {name: (water(*given, CELLS[given[0]][backend]), before) for name, given in TANKS.items()}
    scenes["a column of 99,856 that falls, 2D, h = 2 d"] = water(2, 2.0, {}, 316, wide=4.0), FALLEN
    scenes["a drop of 59,319 with Akinci's tension"] = spinning_cube(39, "akinci"), before
    runs = {name: Simulation(scene, backend, threads) for name, (scene, _) in scenes.items()}
    clock = time.process_time if backend == "cpu" else time.perf_counter
    for name, (_, first) in scenes.items():
        take_steps(runs[name], first)
    seconds: dict[str, list[float]] = {name: [] for name in runs}
    for _ in range(TURNS):
        for name, simulation in runs.items():
            began = clock()
            take_steps(simulation, steps)
            seconds[name].append((clock() - began) / steps)
    return seconds


def perform(given: argparse.Namespace) -> None:
    """The command."""
    stored: dict[str, Any] = json.loads(given.output.read_text(encoding="utf-8")) if given.output.exists() else {}
    about, seconds = environment(given.threads, given.backend), measured(given.backend, given.threads)
    named = {name: about[name] for name in ("date", "processor", "device", "threads", "commit")}
    write_file(given.output, json.dumps(stored | {given.backend: named | {"steps": seconds}}, indent=1) + "\n")
    papers: list[float] = []
    for name, taken in seconds.items():
        papers = taken if "papers'" in name else papers
        over = sorted(own / other for own, other in zip(taken, papers, strict=True))
        words = f"; over the papers' {statistics.median(over):.2f} ({over[0]:.2f} to {over[-1]:.2f})"
        print(f"{name:<42} {1e3 * statistics.median(taken):7.3f} ms a step{words if name in TANKS else ''}")
