"""How a step of each system scales with CPU threads: `python -m validation scaling`, docs/device_limits.md.

Each scene is started once; its threads are changed between readings, and the process is pinned to as many cores as
threads work. A reading is STEPS steps, before the first of which the neighbour list is built anew. Readings of all
numbers of threads take turns.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from refsim import (
    Box,
    Dong2016,
    Gravity,
    JiangZhu2023,
    MeshBoundary,
    MpmLiquid,
    Scene,
    Simulation,
    SurfaceDetection,
    SurfaceEnergy,
    WeaklyCompressible,
)
from refsim.backends.arrays import set_threads

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "validation" / "cpu_scaling.json"
PICTURE = ROOT / "figures" / "cpu_scaling.png"
SCHEMA = "refsim scaling with CPU threads, version 1"
NOT_YET = "not measured yet"
THREADS = (1, 2, 4, 8, 16, 32)
EDGE = 79  # particles along the edge of a cube: 493,039
STEPS = 3  # of a reading; a list serves about ten where liquid moves freely, one where solids melt
ROUNDS, LEAST_ROUNDS = 7, 3
BUDGET = 240.0  # s for everything; starts and LEAST_ROUNDS rounds are not cut short
LIQUID = WeaklyCompressible(sound_speed=20.0, dynamic_viscosity=5.0)


def scenes(edge: int = EDGE) -> dict[str, Callable[[], Scene]]:
    """A scene of each system with about edge^3 particles, float32, in words that the page shows."""
    d = 1.0 / edge
    cube: dict[str, Any] = {"spacing": d, "support_radius": 2.6 * d, "fluid": (Box(cells=(edge,) * 3),)}

    def akinci() -> Scene:
        from validation.experiments.timing.runs import spinning_block

        return spinning_block(edge, 0.5)

    def melting() -> Scene:
        from validation.experiments.melting.scene import made, shared_tank

        return made(shared_tank("figure_6", 2.55 * edge / 100, 1 / 3))

    def mpm() -> Scene:
        cell = 1 / 64
        liquid = Box(lower=(0.2, 0.2, 0.2), cells=(edge,) * 3)
        effects = (MpmLiquid(rest_density=1.0, bulk_modulus=1000.0), SurfaceEnergy(surface_tension=1.0))
        return Scene(spacing=cell / 2, support_radius=1.5 * cell, step=1e-4, fluid=(liquid,), effects=effects)

    def mesh() -> Scene:
        file = str(ROOT / "refsim" / "examples" / "pebble.obj")
        top = 0.623  # of the pebble above its centre [m]
        pebble = MeshBoundary(file=file, center=(0.5, 0.5, -top - d), size=1.25, viscosity=0.1, adhesion=0.1)
        return Scene(effects=(WeaklyCompressible(sound_speed=8.0), Gravity(), pebble), **cube)

    tension, found = JiangZhu2023(surface_tension=0.5), SurfaceDetection(each_step=True)
    return {
        "SPH with Akinci": akinci,
        "Jiang & Zhu with detection": lambda: Scene(effects=(LIQUID, tension, found), **cube),
        "Dong": lambda: Scene(effects=(LIQUID, Dong2016(surface_tension=0.5)), **cube),
        "MPM with surface tension": mpm,
        "melting": melting,
        "mesh coupling": mesh,
    }


def cores() -> list[int]:
    """Cores that this process may use, in order."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(os.cpu_count() or 1))


def pin(some: Sequence[int]) -> None:
    """Let all threads of this process run on these cores only, where the system can do that."""
    if not hasattr(os, "sched_setaffinity"):
        return
    for thread in os.listdir("/proc/self/task"):
        try:
            os.sched_setaffinity(int(thread), some)
        except ProcessLookupError:  # it has ended meanwhile
            continue


def readings(scene: Scene, counts: Sequence[int], seconds: float, rounds: int = ROUNDS) -> dict[str, Any]:
    """Seconds of a step at each number of threads: {"particles", "start", "seconds": {threads: readings}}.

    seconds  that starting and all rounds may take together; LEAST_ROUNDS rounds are made in any case
    """
    own = cores()
    began = time.perf_counter()
    simulation = Simulation(scene, "cpu", threads=max(counts))
    simulation.step()
    start = time.perf_counter() - began
    found: dict[int, list[float]] = {count: [] for count in counts}
    order = np.random.default_rng(0)
    try:
        for turn in range(rounds):
            if turn >= LEAST_ROUNDS and start + (time.perf_counter() - began - start) * (turn + 1) / turn > seconds:
                break
            for count in order.permutation(list(counts)).tolist():
                set_threads(simulation.backend, count)
                pin(own[:count])
                if simulation.search is not None:
                    simulation.lists.policy.invalidate()
                first = time.perf_counter()
                for _ in range(STEPS):
                    simulation.step()
                found[count].append((time.perf_counter() - first) / STEPS)
    finally:
        pin(own)
        set_threads(simulation.backend, None)
    return {"particles": simulation.count, "start": start, "seconds": {str(k): v for k, v in found.items()}}


def measure(edge: int = EDGE, threads: Sequence[int] = THREADS, rounds: int = ROUNDS) -> dict[str, Any]:
    """Everything, as plain values."""
    import numba

    from validation.reading import processor

    most = min(len(cores()), numba.config.NUMBA_NUM_THREADS)
    counts = [count for count in threads if count <= most]
    made, began = {}, time.perf_counter()
    known = scenes(edge)
    for k, (name, scene) in enumerate(known.items()):
        left = BUDGET - (time.perf_counter() - began)
        made[name] = readings(scene(), counts, max(left, 0.0) / (len(known) - k), rounds)
        print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr, flush=True)
    return {
        "schema": SCHEMA,
        "date": datetime.date.today().isoformat(),
        "machine": f"{processor()}, {most} cores",
        "systems": made,
    }


def stored() -> dict[str, Any] | None:
    """What was measured last; None before."""
    return json.loads(STORED.read_text()) if STORED.exists() else None


def complete(found: Mapping[str, Any], before: Mapping[str, Any] | None) -> bool:
    """Whether a measurement has all systems, and no fewer numbers of threads than the one before."""

    def numbers(of: Mapping[str, Any]) -> int:
        return min((len(system["seconds"]) for system in of["systems"].values()), default=0)

    return set(found["systems"]) == set(scenes()) and (before is None or numbers(found) >= numbers(before))


def medians(system: Mapping[str, Any]) -> dict[int, float]:
    """Median seconds of a step by number of threads."""
    return {int(count): float(np.median(seconds)) for count, seconds in system["seconds"].items()}


def table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table."""
    rule = "| --- |" + " --: |" * (len(heading) - 1)
    return [f"| {' | '.join(heading)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)]


def markdown(found: Mapping[str, Any] | None) -> list[str]:
    """The page's table: milliseconds on one thread, and how many times as fast on more."""
    if found is None:
        return [f"Scaling with CPU threads: {NOT_YET}."]
    counts = sorted({int(count) for system in found["systems"].values() for count in system["seconds"]})
    heading = ["system", "particles", "one thread [ms a step]", *(f"{count} threads" for count in counts[1:])]
    rows = []
    for name, system in found["systems"].items():
        times = medians(system)
        speeds = [f"{times[counts[0]] / times[count]:.2f}" for count in counts[1:]]
        rows.append([name, f"{system['particles']:,}", f"{1e3 * times[counts[0]]:,.0f}", *speeds])
    return [*table(heading, rows), "", f"CPU: {found['machine']} ({found['date']})."]


def picture(found: Mapping[str, Any] | None) -> Any:
    """How many times as fast a step is as on one thread, over threads, system by system; ranges of the readings."""
    import matplotlib.pyplot as plt

    from validation.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION

    figure, axes = plt.subplots(figsize=(6.4, 4.4))
    axes.set_title("a step on more threads, over one thread")
    if found is None:
        axes.text(0.5, 0.5, NOT_YET, ha="center", transform=axes.transAxes, color=GREY)
        return figure
    colours = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, SKY)
    most = 1
    for (name, system), colour in zip(found["systems"].items(), colours, strict=True):
        times = medians(system)
        counts = sorted(times)
        most = max(most, *counts)
        speeds = np.array([times[counts[0]] / times[count] for count in counts])
        spans = [system["seconds"][str(count)] for count in counts]
        low = speeds - [times[counts[0]] / max(span) for span in spans]
        high = [times[counts[0]] / min(span) for span in spans] - speeds
        label = f"{name}, {system['particles']:,} particles"
        axes.errorbar(counts, speeds, [low, high], fmt="o-", color=colour, ms=4, lw=1.2, capsize=2, label=label)
    axes.plot([1, most], [1, most], color=GREY, lw=0.8, ls=":", label="as many times as threads")
    axes.set_xscale("log", base=2)
    axes.set_yscale("log", base=2)
    ticks = [2**k for k in range(math.ceil(math.log2(most)) + 1)]
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.set_xlabel("threads, each on a core of its own")
    axes.set_ylabel("times as fast")
    axes.legend(fontsize=7)
    return figure


def renew() -> Path:
    """Measure, and store it; returns where.

    Raises RuntimeError where the measurement has fewer systems or threads than the stored one, which is kept.
    """
    found, before = measure(), stored()
    if not complete(found, before):
        raise RuntimeError(f"{STORED.name} is kept: it has more threads or systems than this machine measured")
    STORED.write_text(json.dumps(found, indent=1) + "\n")
    return STORED
