"""Predicted against measured wall time: twelve scenes that were not used to build the model of `refsim.study.cost`.

`python -m validation measure run_time` predicts each scene on a backend from constants measured anew, runs it to its
end, and puts both into `data/run_time.json`; --write puts their summary on docs/study.md. It needs a machine that does
nothing else. A scene whose row is on file for the backend is not measured again, unless with --fresh.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import statistics
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from refsim import (
    Akinci2013,
    Ball,
    Box,
    BoxWalls,
    CsfWang2019,
    Gravity,
    HeatConduction,
    ImplicitPressure,
    InputError,
    Melting,
    Motion,
    MpmLiquid,
    MpmWalls,
    RunStopped,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    SolidTorus,
    SurfaceDetection,
    TwoWayCoupling,
    WeaklyCompressible,
    make_plan,
)
from refsim.study.cost import Prediction, predict
from validation.filling import replaced
from validation.reading import environment

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "study.md"
MEDIAN, WORST = 0.25, 0.5  # aims for the relative error of the median scene and of each
DOWN = Gravity(acceleration=(0.0, 0.0, -9.81))
DOWN_2D = Gravity(acceleration=(0.0, -9.81, 0.0))


def water(cells: int, fall: float, **more: Any) -> WeaklyCompressible:
    """Water of `cells` particles a metre that falls so far [m], at a viscosity with which it rests."""
    sound = 10.0 * math.sqrt(2 * 9.81 * fall)
    return WeaklyCompressible(sound_speed=sound, dynamic_viscosity=1000.0 * sound * 2.6 / cells / 125.0, **more)


def sloshing(cells: int, end_time: float) -> Scene:
    """A tank of water, 2 m long and 1 m deep, that sways."""
    sway = Motion(of="gravity", kind="sway", direction=(1.0, 0.0, 0.0), amplitude=0.05, period=1.7, ramp=0.5)
    walls = BoxWalls(lower=(0, 0, 0), upper=(2.0, 2.0, 0), open_faces=("+y",))
    return Scene(
        dim=2, spacing=1 / cells, support_radius=2.6 / cells, end_time=end_time, motion=(sway,),
        fluid=(Box(cells=(2 * cells, cells, 1)),), effects=(water(cells, 1.1), DOWN_2D, walls),
    )  # fmt: skip


def couette(cells: int, end_time: float, viscosity: float) -> Scene:
    """A viscous liquid between plates 1 mm apart, of which one moves."""
    d = 1e-3 / cells
    walls = BoxWalls(
        lower=(0, 0, 0), upper=(5e-4, 1e-3, 0), open_faces=("-x", "+x"), viscosity=2 * viscosity, moving_faces=("+y",),
        velocity=(1e-4, 0.0, 0.0),
    )  # fmt: skip
    return Scene(
        dim=2, spacing=d, support_radius=3.0 * d, end_time=end_time, period=(5e-4, 0.0, 0.0),
        fluid=(Box(cells=(cells // 2, cells, 1)),),
        effects=(WeaklyCompressible(sound_speed=2e-3, dynamic_viscosity=viscosity), walls),
    )  # fmt: skip


def poured_torus(cells: int, end_time: float) -> Scene:
    """A ball of water falls on a heavy ring that lies in a box."""
    d = 1.0 / cells
    ring = SolidTorus(center=(1.0, 1.0, 0.35), radius=0.5, tube_radius=0.25, density=4000.0)
    walls = BoxWalls(lower=(0, 0, 0), upper=(2.0, 2.0, 3.0), open_faces=("+z",))
    return Scene(
        spacing=d, support_radius=2.5 * d, end_time=end_time, solid=(ring,),
        fluid=(Ball(center=(1.0, 1.0, 1.3), radius=0.5),),
        effects=(water(cells, 2.0), DOWN, walls, ShapeMatching(), TwoWayCoupling()),
    )  # fmt: skip


def candle(cells: int, end_time: float) -> Scene:
    """A column of wax melts beneath a hot drop and runs down."""
    d = 1.0 / cells
    walls = BoxWalls(lower=(-1.0, -1.0, 0.0), upper=(2.0, 2.0, 4.0), open_faces=("+z",))
    heat = HeatConduction(
        temperature=(20.0, 300.0), conductivity=2e4, heat_capacity=2500.0, melting_point=60.0, latent_heat=2e5,
    )  # fmt: skip
    return Scene(
        spacing=d, support_radius=2.4 * d, end_time=end_time,
        solid=(SolidBox(lower=(0.0, 0.0, 0.0), upper=(1.0, 1.0, 2.0), density=900.0),),
        fluid=(Box(lower=(0.0, 0.0, 2.0), cells=(cells, cells, cells // 2)),),
        effects=(water(cells, 2.5), DOWN, walls, ShapeMatching(), TwoWayCoupling(), heat, Melting()),
    )  # fmt: skip


def mpm_column(cells: int, end_time: float) -> Scene:
    """A column of liquid collapses in the plane by the material point method."""
    walls = MpmWalls(lower=(0.0, 0.0, 0.0), upper=(4.0, 3.0, 0.0))
    return Scene(
        dim=2, spacing=1 / cells, support_radius=2.6 / cells, end_time=end_time,
        fluid=(Box(cells=(cells, 2 * cells, 1)),),
        effects=(MpmLiquid(bulk_modulus=4e6, dynamic_viscosity=2.0), DOWN_2D, walls),
    )  # fmt: skip


def splash(cells: int, end_time: float, *more: Any) -> Scene:
    """A disc of water falls into a basin."""
    walls = BoxWalls(lower=(0, 0, 0), upper=(3.0, 3.0, 0), open_faces=("+y",))
    disc = Ball(center=(1.5, 1.7, 0.0), radius=0.4, velocity=(0.0, -2.0, 0.0))
    return Scene(
        dim=2, spacing=1 / cells, support_radius=2.6 / cells, end_time=end_time,
        fluid=(Box(cells=(3 * cells, cells, 1)), disc), effects=(water(cells, 2.2), DOWN_2D, walls, *more),
    )  # fmt: skip


def implicit(cells: int, end_time: float) -> Scene:
    """A column collapses in space by implicit incompressible SPH."""
    walls = BoxWalls(lower=(0, 0, 0), upper=(2.0, 1.0, 2.0), open_faces=("+z",))
    return Scene(
        spacing=1 / cells, support_radius=2.4 / cells, end_time=end_time, fluid=(Box(cells=(cells, cells, cells)),),
        effects=(water(cells, 1.0, density="summation"), DOWN, walls, ImplicitPressure()),
    )  # fmt: skip


def drop(cells: int, end_time: float, tension: Any, *more: Any) -> Scene:
    """A cube of liquid, 6 mm wide, rounds off, on a plane if there is one."""
    d = 0.006 / cells
    liquid = WeaklyCompressible(sound_speed=4.0, dynamic_viscosity=0.08, density="summation")
    return Scene(
        spacing=d, support_radius=2.7 * d, end_time=end_time, fluid=(Box(cells=(cells, cells, cells)),),
        effects=(liquid, tension, *more),
    )  # fmt: skip


def slab(cells: int, end_time: float) -> Scene:
    """Two blocks of copper, one of them hot, touch."""
    d = 0.1 / cells
    heat = HeatConduction(temperature=(100.0, 0.0), conductivity=400.0, heat_capacity=385.0, density=8960.0)
    halves = (Box(cells=(cells, cells, cells)), Box(lower=(0.1, 0.0, 0.0), cells=(cells, cells, cells)))
    return Scene(spacing=d, support_radius=2.5 * d, end_time=end_time, fluid=halves, effects=(heat,))


PLANE = BoxWalls(lower=(-0.01, -0.01, 0.0), upper=(0.02, 0.02, 0.03), open_faces=("-x", "+x", "-y", "+y", "+z"))
SCENES: dict[str, Any] = {  # end times: half a minute or less on two threads of a quiet machine
    "tank that sways": lambda: sloshing(40, 3.0),
    "Couette cell": lambda: couette(60, 0.1, 1e-3),
    "Couette cell, thick": lambda: couette(60, 0.02, 8e-3),
    "pour on a torus": lambda: poured_torus(24, 0.5),
    "candle that melts": lambda: candle(14, 0.6),
    "column in the plane, MPM": lambda: mpm_column(80, 0.2),
    "splash": lambda: splash(50, 0.6),
    "splash, fan scan": lambda: splash(36, 0.6, SurfaceDetection(method="fan_scan", each_step=True)),
    "column in space, implicit": lambda: implicit(24, 0.3),
    "drop, continuum force": lambda: drop(18, 0.02, CsfWang2019(surface_tension=0.05)),
    "drop on a plane, Akinci": lambda: drop(18, 0.02, Akinci2013(surface_tension=0.05, adhesion=0.02), PLANE),
    "two blocks of copper": lambda: slab(30, 120.0),
}


def held_against(name: str, scene: Scene, backend: str, threads: int | None, budget: float) -> dict[str, Any]:
    """One row: what was predicted, what the run took, and their ratio."""
    plan = make_plan(scene)
    clock = time.perf_counter()
    try:
        found = predict(plan, backend, threads=threads, budget=budget, fresh=True)
    except (InputError, RunStopped) as error:
        found = Prediction(backend, math.nan, note=str(error))
    row = {
        "scene": name, "backend": backend, "particles": plan.grid.count, "predicted": found.seconds,
        "predicted_steps": found.steps, "predicted_builds": found.builds, "predicted_in": time.perf_counter() - clock,
        "note": found.note,
    }  # fmt: skip
    simulation = Simulation(plan, backend, threads)
    seconds = 0.0
    try:
        simulation.step()  # compiles
        first = dict(simulation.timings.first_calls)
        clock = time.perf_counter()
        while simulation.time < scene.end_time:
            simulation.step()
        simulation.backend.synchronize()
        seconds = time.perf_counter() - clock
        later = sum(s for stage, s in simulation.timings.first_calls.items() if stage not in first)
        seconds = (seconds - later) * simulation.steps / max(simulation.steps - 1, 1)
    except RunStopped as stop:
        row["stopped"] = str(stop)
        return row
    builds = simulation.search.log.rebuilds if simulation.search else 0
    return row | {
        "measured": seconds, "steps": simulation.steps, "builds": builds, "ratio": found.seconds / seconds,
        "bytes": found.bytes,
    }  # fmt: skip


def measure_all(
    path: Path, backend: str, threads: int | None, fresh: bool, only: Sequence[str], budget: float
) -> list[dict[str, Any]]:
    """Rows of all scenes; each is kept as it comes."""
    kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    group = kept.setdefault(backend, {"rows": {}})
    rows: dict[str, dict[str, Any]] = {} if fresh else group["rows"]
    for name, make in SCENES.items():
        if name in rows or (only and not any(word in name for word in only)):
            continue
        rows[name] = held_against(name, make(), backend, threads, budget)
        print(line(rows[name]), flush=True)
        about = environment(threads, backend) | {"date": str(datetime.date.today())}
        kept[backend] = about | {"rows": rows}
        path.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    return list(rows.values())


def line(row: Mapping[str, Any]) -> str:
    """One row of the table."""
    if "measured" not in row:
        return f"| {row['scene']} | {row['particles']:,} | {row['predicted']:.3g} | stopped: {row['stopped']} | | | |"
    return (
        f"| {row['scene']} | {row['particles']:,} | {row['predicted']:.3g} | {row['measured']:.3g} | {row['ratio']:.2f}"
        f" | {row['predicted_steps']:,} / {row['steps']:,} | {row['predicted_builds']:,} / {row['builds']:,} |"
    )


def summary(rows: Sequence[Mapping[str, Any]]) -> str:
    """How far the predictions are off, in one sentence."""
    off = [abs(row["ratio"] - 1) for row in rows if "ratio" in row]
    if not off:
        return "no scene was measured"
    within = sum(error <= WORST for error in off)
    return (
        f"median error {100 * statistics.median(off):.0f} % (aim {100 * MEDIAN:.0f} %), largest {100 * max(off):.0f} %;"
        f" {within} of {len(rows)} scenes within {100 * WORST:.0f} %"
    )


def write_page(path: Path, page: Path = PAGE) -> None:
    """Put the summary of every backend on file between its marks on the page."""
    for backend, group in json.loads(path.read_text(encoding="utf-8")).items():
        rows = list(group["rows"].values())
        where = (group["device"] or {}).get("name") or f"{group['processor']}, {group['threads']} threads"
        told = f"Backend {backend}, {where}, {group['date']}: {summary(rows)}."
        page.write_text(
            replaced(page.read_text(encoding="utf-8"), f"run_time {backend}", [told], page), encoding="utf-8"
        )


def perform(given: argparse.Namespace) -> None:
    """The command."""
    rows = measure_all(given.output, given.backend, given.threads, given.fresh, given.only, given.budget)
    print(summary(rows))
    if given.write:
        write_page(given.output)
    if any(not math.isfinite(row["predicted"]) for row in rows):
        print("some scenes could not be predicted", file=sys.stderr)
