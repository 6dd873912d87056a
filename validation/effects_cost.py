"""What each effect costs: `python -m validation effects`, launches, bytes and microseconds a step, effect by effect.

A ladder is a scene to which effects are added one by one. Launches and bytes are the plan's, and those of a run: the
command stops where they differ. Kernels of the backend "cuda" are counted in Numba's CUDA simulator, on scenes of tens
of particles with the same effects. Microseconds on a GPU come from `scripts/gpu_check.py --only effects`.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from refsim import (
    Box,
    BoxWalls,
    Gravity,
    HeatConduction,
    JiangZhu2023,
    Melting,
    MeshBoundary,
    MpmLiquid,
    MpmWalls,
    Scene,
    ShapeMatching,
    Simulation,
    SolidBox,
    SurfaceDetection,
    SurfaceEnergy,
    TwoWayCoupling,
    WeaklyCompressible,
)
from refsim.engine.binding import step_launches
from refsim.scene.plan import make_plan
from refsim.study.memory import bytes_of
from validation.work_precision import REPEATS, unsettled

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "figures" / "effects_cost.json"
PICTURE = ROOT / "figures" / "effects_cost.png"
PAGE = ROOT / "docs" / "effects_cost.md"
REPORTS = ROOT / "validation" / "gpu_reports"
SCHEMA = "refsim cost of effects, version 1"
THREADS = 2
READING = 0.05  # [s] that one reading lasts at least
ROUNDS = 15  # readings of a rung at most; it may settle before
WARM = 10  # steps before the first reading
STEP = 2e-5  # [s], so short that the particles stay where they are and a neighbour list is built once
NOT_YET = "not measured yet"


@dataclass(frozen=True)
class Rung:
    """A scene of a ladder, and what it has beyond the one before."""

    words: str
    scene: Scene


@dataclass(frozen=True)
class Ladder:
    """Scenes to which effects are added one by one."""

    words: str
    rungs: tuple[Rung, ...]


def ladders(small: bool = False) -> dict[str, Ladder]:
    """All ladders; `small` ones have the same effects and tens of particles."""
    return {"sph": _sph(small), "melting": _melting(small), "mpm": _mpm(small), "mesh": _mesh(small)}


def _climb(
    words: str, base: Mapping[str, Any], rungs: Sequence[tuple[str, tuple[Any, ...], Mapping[str, Any]]]
) -> Ladder:
    made = tuple(Rung(said, Scene(effects=effects, step=STEP, **base, **more)) for said, effects, more in rungs)
    return Ladder(words, made)


def _sph(small: bool) -> Ladder:
    edge = 3 if small else 16
    d = 0.01
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (Box(cells=(edge,) * 3),), "name": "effects_sph"}
    plain = WeaklyCompressible(sound_speed=4.0, clamp_pressure=False)
    liquid = WeaklyCompressible(sound_speed=4.0, clamp_pressure=False, dynamic_viscosity=0.5)
    gravity, walls = Gravity(), BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2 * edge * d, edge * d, 2 * edge * d))
    tension = JiangZhu2023(surface_tension=0.07)
    found = SurfaceDetection(each_step=True)
    own: dict[str, Any] = {}
    return _climb(
        "weakly compressible SPH, 3D",
        base,
        [
            ("liquid", (plain,), own),
            ("+ viscosity", (liquid,), own),
            ("+ gravity", (liquid, gravity), own),
            ("+ walls of a box", (liquid, gravity, walls), own),
            ("+ surface detection in each step", (liquid, gravity, walls, found), own),
            ("+ surface tension (Jiang & Zhu)", (liquid, gravity, walls, found, tension), own),
        ],
    )


def _melting(small: bool) -> Ladder:
    wide, deep = (4, 2) if small else (16, 10)
    d = 0.01
    top = wide * d
    base = {
        "spacing": d,
        "support_radius": 2.1 * d,
        "fluid": (Box(cells=(wide, wide, deep)),),
        "name": "effects_melting",
    }
    low = (0.25 * top, 0.25 * top, deep * d)
    solid = {"solid": (SolidBox(lower=low, upper=(0.75 * top, 0.75 * top, deep * d + 0.5 * top)),)}
    liquid = WeaklyCompressible(sound_speed=10.0)
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(top, top, 4 * top))
    fluid = (liquid, Gravity(), walls)
    bodies = (*fluid, ShapeMatching(), TwoWayCoupling())
    warm = HeatConduction(temperature=50.0, melting_point=0.0)
    return _climb(
        "melting solids in a tank, 3D",
        base,
        [
            ("liquid, gravity, walls of a box", fluid, {}),
            ("+ a solid: shape matching and coupling", bodies, solid),
            ("+ conduction of heat", (*bodies, warm), solid),
            ("+ melting", (*bodies, warm, Melting()), solid),
        ],
    )


def _mpm(small: bool) -> Ladder:
    edge = 3 if small else 64
    d = 0.01
    base = {
        "dim": 2, "spacing": d, "support_radius": 3 * d, "fluid": (Box(cells=(edge, edge, 1)),), "name": "effects_mpm",
    }  # fmt: skip
    liquid = MpmLiquid(bulk_modulus=1e4)
    viscous = MpmLiquid(bulk_modulus=1e4, dynamic_viscosity=0.1)
    gravity = Gravity(acceleration=(0.0, -9.81, 0.0))
    walls = MpmWalls(lower=(-0.5, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    surface = SurfaceEnergy(surface_tension=0.07)
    return _climb(
        "material points, 2D",
        base,
        [
            ("liquid", (liquid,), {}),
            ("+ viscosity", (viscous,), {}),
            ("+ gravity", (viscous, gravity), {}),
            ("+ surface energy", (viscous, gravity, surface), {}),
            ("+ walls, which mirror the surface", (viscous, gravity, surface, walls), {}),
        ],
    )


def _mesh(small: bool) -> Ladder:
    edge = 3 if small else 14
    d = 0.02
    file = str(ROOT / "refsim" / "examples" / "pebble.obj")
    middle = 0.5 * edge * d
    place = {"file": file, "center": (middle, middle, -1.5 * middle), "size": 2.5 * middle}
    base = {"spacing": d, "support_radius": 2 * d, "fluid": (Box(cells=(edge,) * 3),), "name": "effects_mesh"}
    fluid = (WeaklyCompressible(sound_speed=8.0), Gravity())
    return _climb(
        "a mesh as boundary, 3D",
        base,
        [
            ("liquid and gravity", fluid, {}),
            ("+ a mesh: pressure of its particles", (*fluid, MeshBoundary(correction="none", **place)), {}),
            ("+ friction", (*fluid, MeshBoundary(correction="none", viscosity=0.1, **place)), {}),
            ("+ adhesion", (*fluid, MeshBoundary(correction="none", viscosity=0.1, adhesion=0.1, **place)), {}),
            ("+ correction of places", (*fluid, MeshBoundary(viscosity=0.1, adhesion=0.1, **place)), {}),
        ],
    )


# What the plan says, and what a run does


def planned(scene: Scene, backend: str) -> dict[str, Any]:
    """Operations of a step, particles and bytes of a scene by its plan."""
    plan = make_plan(scene)
    return {
        "operations": list(step_launches(plan, backend)),
        "particles": plan.grid.count,
        "walls": 0 if plan.walls is None else len(plan.walls.position),
        "fields": sum(plan.field_bytes().values()),
        "bytes": bytes_of(plan, backend)["total"],
    }


def launched(simulation: Simulation) -> list[str]:
    """Operations that one step of a simulation launches, in order; it is advanced by the step.

    On backend "cuda" it is the call that the step's graph is recorded from.
    """
    simulation.timings.launches.clear()
    if simulation.backend.name == "cuda":
        stepper = simulation.stepper
        named, stepper.profiled = stepper.profiled, True  # what is called has its name, and is the same
        try:
            stepper.recorded.call()
        finally:
            stepper.profiled = named
    else:
        simulation.step()
    around = ("neighbours", "sorting")  # between the steps
    return [name for name, count in simulation.timings.launches.items() for _ in range(count) if name not in around]


@contextmanager
def counted_kernels() -> Iterator[list[str]]:
    """Names of the CUDA kernels that are launched meanwhile."""
    from refsim.backends.compile import CudaKernel

    names: list[str] = []
    launch: Callable[..., None] = CudaKernel.__call__

    def counting(self: Any, *arguments: Any) -> None:
        names.append(self.__name__)
        launch(self, *arguments)

    CudaKernel.__call__ = counting  # type: ignore[method-assign]
    try:
        yield names
    finally:
        CudaKernel.__call__ = launch  # type: ignore[method-assign]


def differences(simulation: Simulation, operations: Sequence[str]) -> list[str]:
    """Where the operations that a step launched, or the bytes of the fields, are not the plan's; one sentence each."""
    plan, found = simulation.plan, []
    expected = list(step_launches(plan, simulation.backend.name))
    if list(operations) != expected:
        found.append(f"a step launched {', '.join(operations)}; the plan says {', '.join(expected)}")
    held = sum(array.nbytes for array in simulation.fields.values())
    said = bytes_of(plan, simulation.backend.name)["fields"]
    if held != said:
        found.append(f"the fields hold {held} bytes; the plan says {said}")
    return found


def on_device(name: str, small: bool) -> list[dict[str, Any]]:
    """Kernels of a step of each rung on backend "cuda", and where a run is not its plan."""
    made = []
    for rung in ladders(small)[name].rungs:
        simulation = Simulation(rung.scene, "cuda")
        for _ in range(1 if small else WARM):
            simulation.step()
        with counted_kernels() as kernels:
            operations = launched(simulation)
        print(rung.words, len(kernels), file=sys.stderr, flush=True)
        made.append({"words": rung.words, "kernels": len(kernels), "wrong": differences(simulation, operations)})
    return made


def in_simulator() -> dict[str, list[dict[str, Any]]]:
    """`on_device` of every ladder in Numba's CUDA simulator, in processes of their own. Raises RuntimeError."""
    environment = os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    running = {}
    for name in ladders(True):
        program = (
            "import json; from validation import effects_cost, simulator_threads; simulator_threads.install();"
            f" print(json.dumps(effects_cost.on_device({name!r}, True)))"
        )
        running[name] = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=environment, cwd=ROOT,
        )  # fmt: skip
    found = {}
    for name, process in running.items():
        said, wrong = process.communicate()
        if process.returncode:
            raise RuntimeError(f"the ladder {name!r} in the CUDA simulator: {wrong.strip().splitlines()[-1]}")
        found[name] = json.loads(said.splitlines()[-1])
    return found


def on_cpu(ladder: Ladder, threads: int = THREADS) -> list[dict[str, Any]]:
    """Seconds of a step of each rung in readings that take turns, and where a run is not its plan."""
    simulations, wrong, steps = [], [], []
    for rung in ladder.rungs:
        simulation = Simulation(rung.scene, "cpu", threads)
        for _ in range(WARM):
            simulation.step()
        wrong.append(differences(simulation, launched(simulation)))
        began = time.perf_counter()
        for _ in range(3):
            simulation.step()
        steps.append(max(3, math.ceil(3 * READING / (time.perf_counter() - began))))
        simulations.append(simulation)
    seconds: list[list[float]] = [[] for _ in simulations]
    for turn in range(ROUNDS):
        for simulation, count, own in zip(simulations, steps, seconds):
            if turn >= REPEATS and not unsettled(own):
                continue
            began = time.perf_counter()
            for _ in range(count):
                simulation.step()
            own.append((time.perf_counter() - began) / count)
    return [{"words": rung.words, "seconds": own, "wrong": bad} for rung, own, bad in zip(ladder.rungs, seconds, wrong)]


def measure() -> dict[str, Any]:
    """Everything, as plain values. Raises RuntimeError where a run launches or holds other than its plan says."""
    from validation.reading import processor

    kernels = in_simulator()
    made: dict[str, Any] = {}
    for name, ladder in ladders().items():
        timed = on_cpu(ladder)
        wrong = [f"{name}, {r['words']}: {line}" for r in (*timed, *kernels[name]) for line in r["wrong"]]
        if wrong:
            raise RuntimeError("; ".join(wrong))
        rungs = [
            {
                "words": rung.words,
                **{backend: planned(rung.scene, backend) for backend in ("cpu", "cuda")},
                "kernels": device["kernels"],
                "seconds": own["seconds"],
            }
            for rung, own, device in zip(ladder.rungs, timed, kernels[name])
        ]
        made[name] = {"words": ladder.words, "rungs": rungs}
    return {
        "schema": SCHEMA,
        "date": datetime.date.today().isoformat(),
        "machine": f"{processor()}, {THREADS} threads",
        "ladders": made,
    }


# GPU


def gpu_seconds(folder: Path = REPORTS) -> tuple[str, dict[tuple[str, str], float]]:
    """(device and date, seconds of a step by ladder and rung) of the newest report; ("", {}) without one."""
    newest: tuple[str, str, dict[tuple[str, str], float]] = ("", "", {})
    for file in sorted(folder.glob("*.json")):
        tasks = json.loads(file.read_text()).get("whole check", {}).get("tasks", [])
        own = [task for task in tasks if task["task"].startswith("effects ") and not task["error"]]
        if not own:
            continue
        device = next((str(r["value"]) for t in tasks for r in t["rows"] if r["name"] == "device"), file.stem)
        date = max(str(task["date"]) for task in own)
        found = {
            (task["task"].split()[1], r["name"].removeprefix("step: ")): 1e-6 * float(r["value"])
            for task in own for r in task["rows"] if r["name"].startswith("step: ")
        }  # fmt: skip
        if date > newest[1]:
            newest = f"{device}, {date.split()[0]}", date, found
    return newest[0], newest[2]


# Page and picture


def markdown(found: Mapping[str, Any]) -> list[str]:
    """The page's tables, one a ladder."""
    device, gpu = gpu_seconds()
    lines: list[str] = []
    for name, ladder in found["ladders"].items():
        first = ladder["rungs"][0]["cpu"]["particles"]
        lines += [f"### {ladder['words'][:1].upper()}{ladder['words'][1:]}", ""]
        lines += [f"{first:,} particles of liquid.", ""]
        lines.append(
            "| scene | operations a step, CPU | operations, CUDA | kernels, CUDA | fields [B a particle] |"
            " all [B a particle], CPU | CUDA | step [us], 2 CPU threads | step [us], GPU |"
        )
        lines.append("| --- |" + " --: |" * 8)
        for rung in ladder["rungs"]:
            cpu, cuda = rung["cpu"], rung["cuda"]
            own = gpu.get((name, rung["words"]))
            cells = [
                rung["words"], str(len(cpu["operations"])), str(len(cuda["operations"])), str(rung["kernels"]),
                str(cpu["fields"]),
                *(f"{of['bytes'] / of['particles']:.0f}" for of in (cpu, cuda)),
                microseconds(rung["seconds"]), NOT_YET if own is None else f"{1e6 * own:.0f}",
            ]  # fmt: skip
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    lines.append(f"CPU: {found['machine']} ({found['date']}). GPU: {device or NOT_YET}.")
    return lines


def microseconds(seconds: Sequence[float]) -> str:
    """Median of a step [us]; the range of the readings behind a circle where it has not settled."""
    if unsettled(seconds):
        return f"\u25cb {span(seconds)}"
    return f"{1e6 * float(np.median(seconds)):,.0f}"


def span(seconds: Sequence[float]) -> str:
    """Range of readings [us], two digits: more would say that they repeat."""
    return " to ".join(f"{float(f'{1e6 * value:.2g}'):,.0f}" for value in (min(seconds), max(seconds)))


def picture(found: Mapping[str, Any]) -> Any:
    """Launches, bytes and microseconds as effects are added: a row a ladder, a column a quantity."""
    import matplotlib.pyplot as plt

    from validation.drawing import BLUE, GREY, SKY

    _, gpu = gpu_seconds()
    rows = found["ladders"]
    heights = [len(ladder["rungs"]) for ladder in rows.values()]
    figure, grid = plt.subplots(
        len(rows), 3, figsize=(12.5, 1.2 + 0.42 * sum(heights) + 0.35 * len(rows)), sharey="row",
        gridspec_kw={"height_ratios": heights},
    )  # fmt: skip
    for line, (name, ladder) in zip(grid, rows.items()):
        rungs = ladder["rungs"]
        place = np.arange(len(rungs))
        launches, memory, times = line
        launches.barh(place - 0.2, [len(r["cpu"]["operations"]) for r in rungs], 0.36, color=BLUE)
        launches.barh(place + 0.2, [r["kernels"] for r in rungs], 0.36, color=SKY)
        for k, r in enumerate(rungs):
            _said(launches, len(r["cpu"]["operations"]), k - 0.2, str(len(r["cpu"]["operations"])))
            _said(launches, r["kernels"], k + 0.2, str(r["kernels"]))
        for shift, backend, colour in ((-0.2, "cpu", BLUE), (0.2, "cuda", SKY)):
            each = [r[backend]["bytes"] / r[backend]["particles"] for r in rungs]
            memory.barh(place + shift, each, 0.36, color=colour)
            for k, value in enumerate(each):
                _said(memory, value, k + shift, f"{value:,.0f}")
        times.set_xscale("log")
        least = 1e6 * min([*(min(r["seconds"]) for r in rungs), *gpu.values()])
        low = 10.0 ** math.floor(math.log10(0.7 * least))
        for k, r in enumerate(rungs):
            fast, slow = 1e6 * min(r["seconds"]), 1e6 * max(r["seconds"])
            value = 1e6 * float(np.median(r["seconds"]))
            if unsettled(r["seconds"]):
                times.barh(k - 0.2, slow - fast, 0.36, left=fast, color="white", edgecolor=BLUE, lw=1.0)
                _said(times, slow, k - 0.2, span(r["seconds"]))
            else:
                times.barh(k - 0.2, value - low, 0.36, left=low, color=BLUE)
                _said(times, value, k - 0.2, f"{value:,.0f}")
            own = gpu.get((name, r["words"]))
            if own is None:
                times.text(low, k + 0.2, f" {NOT_YET}", va="center", fontsize=6.5, color=GREY)
            else:
                times.barh(k + 0.2, 1e6 * own - low, 0.36, left=low, color=SKY)
                _said(times, 1e6 * own, k + 0.2, f"{1e6 * own:,.0f}")
        launches.set_yticks(place, [r["words"] for r in rungs], fontsize=8)
        launches.invert_yaxis()
        launches.set_title(
            f"{ladder['words']}, {rungs[0]['cpu']['particles']:,} particles of liquid", loc="left", fontsize=9
        )
        for axes in line:
            axes.grid(True, axis="x")
            axes.grid(False, axis="y")
            axes.margins(x=0.14)
        times.set_xlim(low, 30 * times.get_xlim()[1])
    names = ("launches a step", "bytes a particle", "microseconds a step")
    for axes, words in zip(grid[-1], names):
        axes.set_xlabel(words)
    handles = [
        plt.Rectangle((0, 0), 1, 1, color=BLUE), plt.Rectangle((0, 0), 1, 1, color=SKY),
        plt.Rectangle((0, 0), 1, 1, facecolor="white", edgecolor=BLUE),
    ]  # fmt: skip
    labels = ["CPU (launches: operations)", "CUDA (launches: kernels)", "CPU, not settled: range of the readings"]
    figure.legend(handles, labels, loc="outside upper right", ncols=3, fontsize=8, frameon=False)
    figure.suptitle("What each effect costs", x=0.01, ha="left", fontweight="bold")
    return figure


def _said(axes: Any, x: float, y: float, words: str) -> None:
    axes.text(x, y, f" {words}", va="center", fontsize=6.5)


def stored() -> dict[str, Any]:
    """What was measured last. Raises OSError or ValueError where there is nothing."""
    return json.loads(STORED.read_text())  # type: ignore[no-any-return]


def page(text: str, found: Mapping[str, Any]) -> str:
    """docs/effects_cost.md with its tables renewed."""
    from validation.stability_page import replaced

    return replaced(text, "effects", markdown(found), PAGE)


def write(found: Mapping[str, Any]) -> list[Path]:
    """Renew page and picture; returns their paths."""
    from validation.drawing import save_picture, style

    PAGE.write_text(page(PAGE.read_text(), found))
    with style():
        save_picture(picture(found), PICTURE)
    return [PAGE, PICTURE]


def perform(draw_only: bool) -> list[Path]:
    """Measure, unless stored numbers are only to be drawn, and renew page and picture; returns their paths."""
    if draw_only:
        return write(stored())
    found = measure()
    STORED.write_text(json.dumps(found, indent=1) + "\n")
    return [STORED, *write(found)]
