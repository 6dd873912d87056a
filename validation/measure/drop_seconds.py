"""What a step of a drop costs: the seconds of `tension_cost`, all of one machine, apart from the drops' physics.

`python -m validation measure drop_seconds` times the steps of all drops of the panel on one thread of the CPU, in
turns, and puts them into `data/drop_seconds.json`; with --cuda those on a GPU. It wants a machine that does nothing
else.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from refsim import RunStopped, Simulation
from refsim.study.choice import instability, middle
from refsim.study.panels.drops import FLOW, KICK, THIN, free_drop
from validation.measure.drops import Point, device_points, in_panel, points, start
from validation.running import take_steps

FILE = Path(__file__).resolve().parent.parent / "data" / "drop_seconds.json"
ROUNDS = 5  # blocks of each drop, taken in turns, so that a disturbance falls on all
BLOCK = 0.12  # s that a block takes at least
MOST = {"cpu": 60, "numpy": 2, "cuda": 400}  # steps in a block at most
WARM = (60, 3.0)  # steps, and seconds at most, before the first block, so that no even lattice is timed


def panel_points(device: bool) -> list[Point]:
    """One drop of each model, radius, precision and backend of the panel."""
    wanted = device_points() if device else points(dims=(3,))
    return [p for p in wanted if p.seed == 1 and in_panel(asdict(p))]


def swinging(point: Point) -> Simulation:
    """The drop in its mode n = 2, as it moves while its frequency is read."""
    position = start(point)
    velocity = KICK * math.sqrt(8 / point.radius**3) * FLOW[3] * position
    simulation = Simulation(free_drop(point, position, velocity, THIN), point.backend, threads=1)
    began = time.perf_counter()
    for _ in range(WARM[0]):
        simulation.step()
        if time.perf_counter() - began > WARM[1]:
            break
    return simulation


def block(simulation: Simulation, steps: int) -> float:
    """Seconds of a step, mean over so many."""
    began = time.perf_counter()
    take_steps(simulation, steps)
    simulation.backend.synchronize()
    return (time.perf_counter() - began) / steps


def timed(wanted: Iterable[Point], seconds: float = math.inf) -> list[dict[str, Any]]:
    """One row for each drop whose steps could be taken; drops not begun within 0.7 of `seconds` are left out.

    seconds_per_step   median over the blocks
    deviation          median absolute deviation, as a share of it
    unstable           why the median is not to be trusted, or ""
    """
    began, live = time.perf_counter(), []
    for point in wanted:
        if time.perf_counter() - began > 0.7 * seconds:
            break
        try:
            simulation = swinging(point)
            steps = max(1, min(MOST[point.backend], math.ceil(BLOCK / block(simulation, 2))))
        except RunStopped as stop:
            print(f"{point.key}: {stop.reason}", file=sys.stderr)
            continue
        live.append((point, simulation, steps, []))
    for _ in range(ROUNDS):
        for _, simulation, steps, found in live:
            try:
                found.append(block(simulation, steps))
            except RunStopped:
                found.append(math.nan)
    rows = []
    for point, simulation, steps, found in live:
        median, deviation = middle([v for v in found if math.isfinite(v)])
        rows.append({
            "key": point.key, "particles": simulation.count, "steps": steps, "blocks": len(found),
            "seconds_per_step": float(f"{median:.4g}"), "deviation": round(deviation / median, 4),
            "unstable": instability(found),
        })  # fmt: skip
    return rows


def read(path: Path = FILE) -> dict[str, Any]:
    """{"cpu": {...}, "cuda": {...}}, each with where and when it was measured and its rows; empty without the file."""
    return json.loads(path.read_text()) if path.exists() else {}


def write(kind: str, rows: Sequence[Mapping[str, Any]], where: Mapping[str, Any], path: Path = FILE) -> None:
    """Put the rows of one kind of machine into the file, in place of those that it has."""
    made = read(path) | {kind: {**where, "rows": list(rows)}}
    text = []
    for name in sorted(made):
        head = json.dumps({n: v for n, v in made[name].items() if n != "rows"})[1:-1]
        body = ",\n".join(json.dumps(row) for row in made[name]["rows"])
        text.append(f'"{name}": {{{head}, "rows": [\n{body}\n]}}')
    part = path.with_suffix(".part")
    part.write_text("{\n" + ",\n".join(text) + "\n}\n")
    os.replace(part, path)


def machine(kind: str) -> dict[str, Any]:
    """Where and when: processor or device, date, load."""
    from validation.reading import environment

    found = environment(1, kind)
    name = found["processor"] if kind == "cpu" else (found["device"] or {}).get("name", "a CUDA device")
    return {
        "machine": name,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "load": round(found["load"], 2) if found["load"] is not None else None,
        "versions": {n: found["versions"].get(n) for n in ("refsim", "numba", "numba-cuda", "numpy")},
    }


def perform(given: argparse.Namespace) -> None:
    """Time the drops and keep their rows; prints one line each."""
    kind = "cuda" if given.cuda else "cpu"
    where, began = machine(kind), time.perf_counter()
    wanted = (p for p in panel_points(given.cuda) if given.models is None or p.model in given.models)
    rows = timed(wanted, given.seconds)
    for row in rows:
        words = f"{1e3 * row['seconds_per_step']:9.3f} ms a step +- {100 * row['deviation']:.1f} %"
        print(f"{row['key']:<58} {words} {row['unstable']}")
    write(kind, rows, where, given.output)
    print(f"{len(rows)} drops, {time.perf_counter() - began:.0f} s, {where['machine']}, load {where['load']}")
