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

import msgspec

from refsim import (
    Ball,
    Box,
    BoxWalls,
    Dong2016,
    Gravity,
    HeatConduction,
    ImplicitPressure,
    JiangZhu2023,
    Melting,
    MeshBoundary,
    MpmLiquid,
    MpmWalls,
    RunStopped,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBall,
    SurfaceDetection,
    SurfaceEnergy,
    TwoWayCoupling,
    WeaklyCompressible,
    make_plan,
)
from refsim.study.cost import predict
from validation.filling import replaced
from validation.reading import environment

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "study.md"
MEDIAN, WORST = 0.25, 0.5  # aims for the relative error of the median scene and of each
DOWN = Gravity(acceleration=(0.0, 0.0, -9.81))
DOWN_2D = Gravity(acceleration=(0.0, -9.81, 0.0))


def column_2d(cells: int, end_time: float, *more: Any) -> Scene:
    """A column of water, 1 m wide and 2 m high, collapses in a tank 3 m wide."""
    liquid = WeaklyCompressible(sound_speed=62.0, dynamic_viscosity=700.0 / cells, state="tait", density="summation")
    walls = BoxWalls(lower=(0, 0, 0), upper=(3.0, 3.0, 0), open_faces=("+y",))
    return Scene(
        dim=2, spacing=1 / cells, support_radius=2.6 / cells, end_time=end_time,
        fluid=(Box(cells=(cells, 2 * cells, 1)),), effects=(liquid, DOWN_2D, walls, *more),
    )  # fmt: skip


def column_3d(cells: int, end_time: float) -> Scene:
    """A column of water, 1 x 1 x 1.5 m, collapses in a tank 2 m long."""
    liquid = WeaklyCompressible(sound_speed=55.0, dynamic_viscosity=600.0 / cells, state="tait", density="summation")
    walls = BoxWalls(lower=(0, 0, 0), upper=(2.0, 1.0, 2.0), open_faces=("+z",))
    return Scene(
        spacing=1 / cells, support_radius=2.4 / cells, end_time=end_time,
        fluid=(Box(cells=(cells, cells, 3 * cells // 2)),), effects=(liquid, DOWN, walls),
    )  # fmt: skip


def implicit(cells: int, end_time: float) -> Scene:
    """The column in the plane by implicit incompressible SPH."""
    scene = column_2d(cells, end_time)
    return msgspec.structs.replace(scene, effects=(*scene.effects, ImplicitPressure()))


def drop(cells: int, end_time: float, tension: Any) -> Scene:
    """A cube of liquid, 8 mm wide, rounds off."""
    d = 0.008 / cells
    liquid = WeaklyCompressible(sound_speed=3.6, dynamic_viscosity=0.1, kernels="mueller", density="summation")
    return Scene(
        spacing=d, support_radius=2.6 * d, end_time=end_time, effects=(liquid, tension),
        fluid=(Box(lower=(-0.004,) * 3, cells=(cells,) * 3),),
    )  # fmt: skip


def mpm_drop(cells: int, end_time: float) -> Scene:
    """A slab of liquid draws together by the material point method with surface energy."""
    d = 0.012 / cells
    box = Box(lower=(-0.006, -0.006, -0.003), cells=(cells, cells, cells // 2))
    liquid = MpmLiquid(bulk_modulus=3000.0, dynamic_viscosity=0.06)
    return Scene(
        spacing=d, support_radius=2.5 * d, end_time=end_time, fluid=(box,),
        effects=(liquid, SurfaceEnergy(surface_tension=0.05, enclose_volume=True)),
    )  # fmt: skip


def mpm_column(cells: int, end_time: float) -> Scene:
    """A column of liquid collapses by the material point method."""
    walls = MpmWalls(lower=(0.0, 0.0, 0.0), upper=(2.0, 1.0, 2.0))
    return Scene(
        spacing=1 / cells, support_radius=2.5 / cells, end_time=end_time, fluid=(Box(cells=(cells, cells, cells)),),
        effects=(MpmLiquid(bulk_modulus=1e5, dynamic_viscosity=1.0), DOWN, walls),
    )  # fmt: skip


def ice(cells: int, end_time: float, solid: Any) -> Scene:
    """A body of ice falls into warm water and melts (Shao & Song 2017)."""
    d = 3.0 / cells
    return Scene(
        spacing=d, support_radius=2.5 * d, step=0.3 * d / 15.0, end_time=end_time, solid=(solid,),
        fluid=(Box(cells=(cells, cells, cells // 2)),),
        effects=(
            WeaklyCompressible(sound_speed=35.0, dynamic_viscosity=50.0, state="tait", kernels="cubic_spline",
                               density="summation"),
            DOWN, BoxWalls(lower=(0.0, 0.0, 0.0), upper=(3.0, 3.0, 4.5)), ShapeMatching(), TwoWayCoupling(),
            HeatConduction(temperature=(-5.0, 30.0), conductivity=0.25, melting_point=0.0, literal=("M11",)), Melting(),
        ),
    )  # fmt: skip


def pebble(cells: int, end_time: float) -> Scene:
    """A ball of liquid falls on a pebble."""
    d = 0.16 / cells
    liquid = WeaklyCompressible(sound_speed=22.0, dynamic_viscosity=260.0 * d, density="summation")
    stone = MeshBoundary(file=str(ROOT / "refsim" / "examples" / "pebble.obj"), center=(0.0, 0.0, 0.0), viscosity=0.5)
    return Scene(
        spacing=d, support_radius=2.7 * d, end_time=end_time, fluid=(Ball(center=(0.0, 0.0, 0.2), radius=0.08),),
        effects=(liquid, DOWN, stone),
    )  # fmt: skip


SCENES: dict[str, Any] = {  # end times: a minute or less on two threads of a quiet machine
    "column, 2D": lambda: column_2d(24, 0.8),
    "column, 2D, detection": lambda: column_2d(70, 0.2, SurfaceDetection(each_step=True)),
    "column, 2D, implicit pressure": lambda: implicit(50, 0.4),
    "column, 3D": lambda: column_3d(30, 0.15),
    "column, 3D, a million": lambda: column_3d(88, 0.01),
    "drop, Jiang & Zhu": lambda: drop(16, 0.02, JiangZhu2023(surface_tension=0.06)),
    "drop, Jiang & Zhu, large": lambda: drop(46, 0.0015, JiangZhu2023(surface_tension=0.06)),
    "drop, Dong": lambda: drop(20, 0.01, Dong2016(surface_tension=0.06)),
    "drop, MPM with surface energy": lambda: mpm_drop(30, 0.006),
    "column, MPM": lambda: mpm_column(60, 0.06),
    "ice ball in water": lambda: ice(24, 0.6, SolidBall(center=(1.5, 1.5, 2.2), radius=0.45)),
    "liquid on a mesh": lambda: pebble(32, 0.1),
}


def held_against(name: str, scene: Scene, backend: str, threads: int | None, budget: float) -> dict[str, Any]:
    """One row: what was predicted, what the run took, and their ratio."""
    plan = make_plan(scene)
    clock = time.perf_counter()
    found = predict(plan, backend, threads=threads, budget=budget, fresh=True)
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
    path: Path, backend: str, threads: int | None, largest: int, fresh: bool, only: Sequence[str], budget: float
) -> list[dict[str, Any]]:
    """Rows of all scenes up to `largest` particles; each is kept as it comes."""
    kept: dict[str, Any] = json.loads(path.read_text()) if path.exists() else {}
    group = kept.setdefault(backend, {"rows": {}})
    rows: dict[str, dict[str, Any]] = {} if fresh else group["rows"]
    for name, make in SCENES.items():
        if name in rows or (only and not any(word in name for word in only)):
            continue
        scene = make()
        if make_plan(scene).grid.count > largest:
            continue
        rows[name] = held_against(name, scene, backend, threads, budget)
        print(line(rows[name]), flush=True)
        about = environment(threads, backend) | {"date": str(datetime.date.today())}
        kept[backend] = about | {"rows": rows}
        path.write_text(json.dumps(kept, indent=1) + "\n")
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
        f" {within} of {len(off)} scenes within {100 * WORST:.0f} %"
    )


def write_page(path: Path, page: Path = PAGE) -> None:
    """Put the summary of every backend on file between its marks on the page."""
    for backend, group in json.loads(path.read_text()).items():
        rows = list(group["rows"].values())
        where = (group["device"] or {}).get("name") or f"{group['processor']}, {group['threads']} threads"
        told = f"Backend {backend}, {where}, {group['date']}: {summary(rows)}."
        page.write_text(replaced(page.read_text(), f"run_time {backend}", [told], page))


def perform(given: argparse.Namespace) -> None:
    """The command."""
    rows = measure_all(given.output, given.backend, given.threads, given.largest, given.fresh, given.only, given.budget)
    print(summary(rows))
    if given.write:
        write_page(given.output)
    if any(not math.isfinite(row["predicted"]) for row in rows):
        print("some scenes could not be predicted", file=sys.stderr)
