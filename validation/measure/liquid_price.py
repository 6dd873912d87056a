"""What the liquid's options cost: a step of a cubic tank at rest with each of them, in turns on the same cores.

`python -m validation measure liquid_price` takes steps 14 to 74 of each tank, one of each in turn, in processor time.
It stores medians of the steps that keep the list and of those that build one.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import time
from typing import Any

from refsim import Box, BoxWalls, Gravity, Scene, Simulation, WeaklyCompressible
from refsim.core.writing import write_file
from refsim.surface_tension.akinci_2013 import Akinci2013
from validation.reading import environment
from validation.running import take_steps

CELLS, FIRST, LAST = 32, 14, 74
SOUND = 10 * math.sqrt(9.81)  # of a tank 1 m deep [m/s]
PAPERS: dict[str, Any] = {"density": "summation"}
CENTRAL: dict[str, Any] = {**PAPERS, "viscosity": "central"}
ADVANCED: dict[str, Any] = {"density": "continuity"}
TENSION = (Akinci2013(surface_tension=0.07),)  # N/m
# support radius over the spacing, liquid, model of the walls, further effects; after the papers' liquid those beside it
TANKS: dict[str, tuple[float, dict[str, Any], Any, tuple[Any, ...]]] = {
    "the papers' liquid, h = 2.6 d": (2.6, PAPERS, None, ()),
    "with central viscosity": (2.6, CENTRAL, None, ()),
    "and extrapolated walls": (2.6, CENTRAL, "extrapolated", ()),
    "and advanced density": (2.6, ADVANCED, None, ()),
    "without diffusion": (2.6, {**ADVANCED, "diffusion": 0.0}, None, ()),
    "with shifting: the default": (2.6, {}, None, ()),
    "the papers' liquid with tension": (2.6, PAPERS, None, TENSION),
    "advanced, with Akinci's tension": (2.6, ADVANCED, None, TENSION),
    "without `restoring`": (2.6, {**ADVANCED, "restoring": 0.0}, None, TENSION),
    "the papers' liquid, h = 3.2 d": (3.2, PAPERS, None, ()),
    "advanced density, h = 3.2 d": (3.2, ADVANCED, None, ()),
    "the papers' liquid, h = 4.0 d": (4.0, PAPERS, None, ()),
    "advanced density, h = 4.0 d": (4.0, ADVANCED, None, ()),
}


def tank(h: float, liquid: dict[str, Any], model: Any, more: tuple[Any, ...], cells: int) -> Scene:
    """A cube of water, 1 m deep, with `cells` particles along its edge, that fills the lower half of its box."""
    d = 1 / cells
    effects = (
        WeaklyCompressible(sound_speed=SOUND, dynamic_viscosity=1000 * SOUND * h * d / 125, **liquid), Gravity(),
        BoxWalls(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 2.0), model=model), *more,
    )  # fmt: skip
    return Scene(spacing=d, support_radius=h * d, fluid=(Box(cells=(cells,) * 3),), effects=effects, dtype="float32")


def measured(threads: int, cells: int = CELLS, last: int = LAST) -> dict[str, dict[str, float]]:
    """Processor seconds of a step from FIRST to `last` that keeps the list, of one that builds it, and of the mean."""
    tanks = {name: Simulation(tank(*given, cells), "cpu", threads) for name, given in TANKS.items()}
    seconds: dict[str, dict[str, list[float]]] = {name: {"kept": [], "built": []} for name in tanks}
    for simulation in tanks.values():
        take_steps(simulation, FIRST)
    for _ in range(FIRST, last):
        for name, simulation in tanks.items():
            assert simulation.search is not None
            log = simulation.search.log
            builds, began = log.rebuilds, time.process_time()
            simulation.step()
            seconds[name]["kept" if log.rebuilds == builds else "built"].append(time.process_time() - began)
    medians = {
        name: {kind: statistics.median(spent) for kind, spent in kinds.items() if spent}
        for name, kinds in seconds.items()
    }
    for name, spent in medians.items():  # a mean of steps at their medians, which no other work on the machine moves
        spent["mean"] = sum(spent[kind] * len(seconds[name][kind]) for kind in list(spent)) / (last - FIRST)
    return medians


def perform(given: argparse.Namespace) -> None:
    """The command."""
    stored: dict[str, Any] = json.loads(given.output.read_text(encoding="utf-8")) if given.output.exists() else {}
    for threads in given.threads:
        about = environment(threads, "cpu")
        kept = {name: about[name] for name in ("date", "processor", "commit")}
        stored[str(threads)] = {**kept, "tanks": measured(threads)}
        write_file(given.output, json.dumps(stored, indent=1) + "\n")
        papers = ""
        for name, steps in stored[str(threads)]["tanks"].items():
            papers = name if "papers'" in name else papers
            over = (steps[kind] / stored[str(threads)]["tanks"][papers][kind] for kind in ("kept", "mean"))
            print(f"{name:<40} {1e3 * steps['kept']:6.1f} ms a step that keeps its list; over the papers'", *over)
