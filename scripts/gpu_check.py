"""Check the CUDA backend on a real GPU and add what was found to the device's report in validation/gpu_reports/.

    python scripts/gpu_check.py [--quick] [--only PREFIX ...] [--minutes 6] [--workers 6] [--devices 1]

Every task runs in a process of its own, because one illegal memory access ends CUDA for the whole process: the
pairing suite of the contract for each operation and dtype, the neighbour search against the CPU's and all pairs, whole
runs against the CPU, every two effects in one small scene against the references, bitwise repetition, and launches and
bytes against the plan. A task that fails is reported and the others go on. Times are benchmarks (`tests/times`). Exit
code 0 all well, 2 no GPU, 4 something failed or did not end in time.

In the CUDA simulator the script runs too, with tiny sizes, so that the script itself can be tried without a GPU.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import datetime
import json
import os
import pathlib
import queue
import re
import subprocess
import sys
import time
import traceback
from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
REPORTS = ROOT / "validation" / "gpu_reports"
sys.path.insert(0, str(ROOT))

from refsim import (  # noqa: E402  (from this working tree)
    Akinci2013,
    Ball,
    Box,
    BoxWalls,
    Dong2016,
    Gravity,
    ImplicitPressure,
    JiangZhu2023,
    Scene,
    Simulation,
    SurfaceDetection,
    WeaklyCompressible,
    load_scene,
    make_plan,
)
from refsim.backends import arrays as backend  # noqa: E402
from refsim.backends import runtime  # noqa: E402
from refsim.commands.plan import describe_plan  # noqa: E402
from refsim.core.operation import REGISTRY  # noqa: E402
from refsim.core.streams import any_letter  # noqa: E402
from refsim.core.versions import commit  # noqa: E402
from refsim.core.writing import write_file  # noqa: E402
from refsim.study.memory import bytes_of  # noqa: E402
from validation import pairs, searches, timed  # noqa: E402
from validation.experiments.melting.scene import scene_of  # noqa: E402
from validation.reading import environment  # noqa: E402

DTYPES = ("float32", "float64")
MARK = "gpu_check result: "
COMPARED = {"float32": 5, "float64": 20}  # steps before two backends are compared: rounding grows with each
# Share of the largest value. On the CPU, float32 and float64 already differ by 2 % in the pressure of the dam break
# after five steps, because a liquid at rest has almost none. The pairing tests accuracy; this tests whole runs.
TOLERANCE = {"float32": 0.1, "float64": 1e-8}
# Fields that are rounding errors before any deformation, by the scale of their errors: a length, a rate.
OF_SPACING = ("region_anchor", "region_center", "position_residual")
OF_SHAKING = ("region_spin",)
FLAGS = {"float32": 2e-3, "float64": 0.0}  # share of flags that may differ

Row = dict[str, Any]


def row(name: str, value: Any, unit: str = "", tolerance: str = "", verdict: str = "shown", words: str = "") -> Row:
    """One line of the report."""
    return {"name": name, "value": value, "unit": unit, "tolerance": tolerance, "verdict": verdict, "words": words}


def judged(name: str, value: float, limit: float, unit: str = "", words: str = "") -> Row:
    """A value that passes if it is at most the limit."""
    return row(name, value, unit, f"<= {limit:g}", "pass" if value <= limit else "fail", words)


def without_paths(text: str) -> str:
    """Text with the folders taken out of its paths: a report names no machine."""
    return re.sub(r"(?<![\w.])(?:/[\w.@+~-]+)+/([\w.@+~-]+)", r"\1", text)


def device_task(_: list[str]) -> list[Row]:
    """Which device, which versions."""
    where = environment(None, "cuda")
    rows = [row(name, version) for name, version in where["versions"].items()]
    if runtime.simulated():
        return [*rows, row("device", "CUDA simulator")]
    return [*rows, row("device", where["device"]["name"]), row("driver", where["device"].get("driver_version"))]


def pairing_task(arguments: list[str]) -> list[Row]:
    """The contract's ladder for one operation in one dtype."""
    from refsim import contract

    name, dtype = arguments
    outcomes = list(contract.trials(contract.refsim_programs("cuda"), name, (dtype,)))
    bad = [outcome for outcome in outcomes if not outcome.passed]
    finite = [outcome.error for outcome in outcomes if np.isfinite(outcome.error)]
    worst, verdict = float(f"{max(finite, default=0.0):.3g}"), "fail" if bad or not outcomes else "pass"
    return [row(f"{len(outcomes)} trials", worst, "of the bound", "<= 1", verdict)] + [
        row(f"{o.step} {o.trial}", o.error, "of the bound", "<= 1", "fail", str(o)) for o in bad[:5]
    ]


def search_task(arguments: list[str]) -> list[Row]:
    """The neighbour list of a cloud against the CPU's and against all pairs."""
    return [judged(*found) for found in searches.compare(int(arguments[0]), arguments[1])]


def dam_break() -> Scene:
    """A 2D column with walls and surface detection."""
    cells = (4, 6, 1) if runtime.simulated() else (40, 80, 1)
    spacing = 1.0 / cells[1]
    liquid = WeaklyCompressible(sound_speed=45.0, dynamic_viscosity=0.5, state="tait", density="summation")
    walls = BoxWalls(lower=(0.0, 0.0, 0.0), upper=(2.0, 2.0, 0.0))
    effects = (liquid, Gravity(acceleration=(0.0, -9.81, 0.0)), walls, SurfaceDetection())
    return Scene(dim=2, spacing=spacing, support_radius=2 * spacing, fluid=(Box(cells=cells),), effects=effects)


def drop_of(*effects: Any, cube: bool = False) -> Callable[[], Scene]:
    """A ball, or a cube of 17^3 particles, of liquid under these effects."""

    def scene() -> Scene:
        spacing, small = 1e-3, runtime.simulated()
        liquid = Box(cells=((3 if small else 17),) * 3) if cube else Ball(radius=(2 if small else 6) * spacing)
        return Scene(spacing=spacing, support_radius=2 * spacing, fluid=(liquid,), effects=effects)

    return scene


def pebble() -> Scene:
    """The example refsim/examples/mesh_boundary.toml from first contact on: before, pressures are rounding errors."""
    scene = load_scene(ROOT / "refsim" / "examples" / "mesh_boundary.toml")
    column = msgspec.structs.replace(scene.fluid[0], lower=(-0.05, -0.05, 0.056), velocity=(0.0, 0.0, -1.0))
    return msgspec.structs.replace(scene, fluid=(column,))


LIQUID = WeaklyCompressible(sound_speed=3.0, dynamic_viscosity=0.05, density="summation")
SCENES: dict[str, Callable[[], Scene]] = {
    "dam_break": dam_break,
    "droplet": drop_of(LIQUID, JiangZhu2023(surface_tension=0.07, density_correction=True), cube=True),
    "akinci": drop_of(LIQUID, Akinci2013(surface_tension=0.07)),
    "dong": drop_of(LIQUID, Dong2016(surface_tension=0.07)),
    "implicit": drop_of(LIQUID, ImplicitPressure(), Akinci2013(surface_tension=0.07)),
    "pebble": pebble,
    "melting": lambda: scene_of("figure_4", 0.2 if runtime.simulated() else 0.4),
    "energy": timed.systems(4 if runtime.simulated() else 12)["MPM with surface tension"],
}


def run_task(arguments: list[str]) -> list[Row]:
    """A whole run against the CPU after a few steps, and against itself after many."""
    name, dtype, steps = arguments[0], arguments[1], int(arguments[2])
    compared = 2 if runtime.simulated() else COMPARED[dtype]
    steps = max(steps if not runtime.simulated() else 3, compared)
    scene = msgspec.structs.replace(SCENES[name](), dtype=dtype)
    oracle = Simulation(scene, "numpy" if runtime.simulated() else "cpu")
    runs = [Simulation(scene, "cuda") for _ in range(2)]
    for _ in range(compared):
        for simulation in (oracle, *runs):
            result = simulation.step()
    for simulation in (oracle, *runs):
        simulation.evaluate()
    rows = []
    grid = runs[0].plan.grid
    shaking = float(np.abs(oracle.field("velocity")).max()) / grid.spacing  # [1/s]
    for field, kind in runs[0].plan.fields.items():
        if field in ("place", "cell"):  # depend on when the list or the grid's blocks were built
            continue
        true, values = oracle.field(field), runs[0].field(field)
        if kind.numpy_dtype(dtype).kind in "iub":
            rows.append(judged(f"{field}: share that differs", float((true != values).mean()), FLAGS[dtype]))
        else:
            least = grid.spacing if field in OF_SPACING else shaking if field in OF_SHAKING else 0.0
            error = float(np.abs(true - values).max() / max(np.abs(true).max(), least, 1e-30))
            rows.append(judged(f"{field} against the {oracle.backend.name} run", error, TOLERANCE[dtype], "of largest"))
    began = time.perf_counter()
    for simulation in runs:
        for _ in range(steps - compared):
            result = simulation.step()
    took = time.perf_counter() - began
    differing = sum(not np.array_equal(*(s.field(field) for s in runs)) for field in runs[0].plan.fields)
    infinite = float((~np.isfinite(runs[0].field("velocity"))).sum())
    rows.append(judged(f"fields that differ between two runs after {steps} steps", differing, 0))
    rows.append(judged("speeds at the end that are not finite", infinite, 0))
    if runs[0].search is not None:  # the material point method keeps no list
        log = runs[0].search.log
        rows += [judged("neighbours missed", log.missed_neighbours, 0), row("rebuilds of the list", log.rebuilds)]
    rows.append(row("simulated time", float(f"{result.time:.5g}"), "s", words=f"step limited by {result.limiter}"))
    if steps > compared:
        rows.append(row("time per step", float(f"{1e3 * took / (2 * (steps - compared)):.4g}"), "ms"))
    return rows


def pair_task(arguments: list[str]) -> list[Row]:
    """Two effects in one small scene against the references, after five steps in float64."""
    differences = pairs.compare(arguments[0], arguments[1], "cuda")
    return [
        judged(f"{part.field} against the numpy run", part.error, part.allowed, "of largest") for part in differences
    ]


def plan_task(arguments: list[str]) -> list[Row]:
    """Launches and bytes of a step of each scene of a ladder, and the memory of a large cube, against the plan."""
    if arguments[0] in timed.CUBES:
        plan = make_plan(timed.spinning_cube(4 if runtime.simulated() else 100, arguments[0]))
        simulation = Simulation(plan, "cuda")
        simulation.step()  # the list then holds the lattice that the plan counts
        said, off = describe_plan(plan, "cuda")["bytes"]["total"], 0.0
        if not runtime.simulated():
            import cupy

            off = abs(cupy.get_default_memory_pool().used_bytes() / said - 1)
        return [judged("memory held, off what the plan says", round(off, 3), 0.1, words=f"{said / 2**20:.0f} MiB")]
    rows = []
    for rung in timed.ladders(runtime.simulated())[arguments[0]].rungs:
        simulation = Simulation(rung.scene, "cuda")
        simulation.step()
        wrong = timed.differences(simulation, timed.launched(simulation))
        rows.append(judged(f"launches and bytes off the plan: {rung.words}", len(wrong), 0, words="; ".join(wrong)))
        said, liquid = bytes_of(simulation.plan, "cuda"), simulation.parameters.get("mpm_liquid")
        if liquid is not None and "surface_energy" not in simulation.plan.effects:
            off = abs(liquid["grid"].bytes() - said["background_grid"])
            rows.append(judged(f"bytes of the background grid off the plan: {rung.words}", off, 0, "B"))
    return rows


TASKS: dict[str, Callable[[list[str]], list[Row]]] = {
    "device": device_task, "pairing": pairing_task, "search": search_task, "run": run_task, "pair": pair_task,
    "plan": plan_task,
}  # fmt: skip


def planned(quick: bool) -> list[str]:
    """All tasks but "device"."""
    tasks = [f"search {dim} {dtype}" for dim in (2, 3) for dtype in DTYPES]
    tasks += [f"run {name} {dtype} {100 if quick else 1000}" for name in SCENES for dtype in DTYPES]
    tasks += [f"pairing {name} {dtype}" for name in REGISTRY for dtype in (DTYPES[:1] if quick else DTYPES)]
    tasks += [f"pair {first} {second}" for first, second in pairs.pairs()]
    return tasks + [f"plan {name}" for name in (*timed.ladders(), *timed.CUBES)]


def executed(task: str, deadline: float, devices: queue.SimpleQueue[dict[str, str]]) -> dict[str, Any]:
    """Run a task in a process of its own, its GPU named by variables of `devices`: task, rows, seconds, error."""
    device, began = devices.get(), time.monotonic()
    answer: dict[str, Any] = {"task": task, "rows": [], "error": None}
    try:
        if deadline - began < 5:
            return answer | {"error": "not run: no time was left", "seconds": 0.0}
        process = subprocess.run(
            [sys.executable, __file__, "--task", task], capture_output=True, text=True,
            timeout=deadline - began, env=os.environ | device,
        )  # fmt: skip
        lines = [line for line in process.stdout.splitlines() if line.startswith(MARK)]
        if lines:
            answer |= json.loads(lines[-1].removeprefix(MARK))
        else:
            last = (process.stderr.strip().splitlines() or ["no words"])[-1]
            answer["error"] = f"the process ended with code {process.returncode}: {without_paths(last)[:300]}"
    except subprocess.TimeoutExpired:
        answer["error"] = f"not ended after {time.monotonic() - began:.0f} s"
    finally:
        devices.put(device)
    return answer | {"seconds": round(time.monotonic() - began, 1)}


def failed(answer: dict[str, Any]) -> bool:
    """Whether a task broke off or one of its verdicts is a failure."""
    return bool(answer["error"]) or any(r["verdict"] == "fail" for r in answer["rows"])


def tell(answer: dict[str, Any]) -> None:
    """Print what a task found."""
    print(f"{'FAIL' if failed(answer) else 'ok  '} {answer['task']}  ({answer['seconds']} s)", flush=True)
    if answer["error"]:
        print(f"       {answer['error']}", flush=True)
    for r in answer["rows"]:
        if r["verdict"] == "fail" or not answer["task"].startswith("pairing"):
            text = f"       {r['name']}: {r['value']} {r['unit']} {r['tolerance']}".rstrip()
            print(f"{text}  {r['words']}{'  FAIL' if r['verdict'] == 'fail' else ''}".rstrip(), flush=True)


SECTION, NO_TIME = "whole check", ("not run", "not ended")


def write(answers: list[dict[str, Any]], path: pathlib.Path) -> None:
    """Put tasks that ran to their end in place of their like in a device's report, a task a line."""
    whole = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    kept = {a["task"]: a for a in whole.get(SECTION, {}).get("tasks", [])}
    kept |= {a["task"]: a for a in answers if not (a["error"] or "").startswith(NO_TIME)}
    whole[SECTION] = {"tasks": [kept[task] for task in ("device", *planned(False)) if task in kept]}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_file(path, json.dumps(whole, separators=(",", ":")).replace('{"task"', '\n{"task"') + "\n")
    print(f"report: {path}")


def work(task: str) -> int:
    """Inside a task's process: run it and print its rows as JSON."""
    kind, *arguments = task.split()
    answer: dict[str, Any] = {"rows": [], "error": None}
    try:
        answer["rows"] = TASKS[kind](arguments)
    except Exception as error:
        traceback.print_exc()
        first = (str(error).strip().splitlines() or [""])[0]
        where = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{pathlib.Path(where.filename).name} line {where.lineno}"
        answer["error"] = without_paths(f"{type(error).__name__}: {first[:300]} ({place})")
    print(MARK + json.dumps(answer, default=float))
    return 4 if answer["error"] else 0


@any_letter()
def main() -> int:
    """Run everything and write the report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="float32 pairing, short runs")
    parser.add_argument("--only", nargs="+", default=[""], metavar="PREFIX", help="tasks whose names start like these")
    parser.add_argument("--minutes", type=float, default=6.0, help="time for everything")
    parser.add_argument("--workers", type=int, default=6, help="processes that share a GPU (1 below 8 cores)")
    parser.add_argument("--devices", type=int, default=1, help="GPUs of this machine that share what is not timed")
    parser.add_argument("--folder", type=pathlib.Path, default=REPORTS, help="where the report is written")
    parser.add_argument("--task", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.task:
        return work(options.task)
    deadline = time.monotonic() + 60 * options.minutes
    if reason := backend.unavailable("cuda"):
        print(f"The GPU cannot be checked: {reason}.", file=sys.stderr)
        return 2
    known = [json.loads(path.read_text(encoding="utf-8"))[SECTION]["tasks"] for path in REPORTS.glob("*.json")]
    took = {answer["task"]: answer["seconds"] for answers in known for answer in answers}
    tasks = [task for task in planned(options.quick) if task.startswith(tuple(options.only))]
    tasks.sort(key=lambda task: -took.get(task, np.inf))  # so that no worker waits for a long one at the end
    places = (options.workers if (os.cpu_count() or 1) >= 8 else 1) * options.devices
    devices: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
    for place in range(places):
        devices.put({"CUDA_VISIBLE_DEVICES": str(place % options.devices)} if options.devices > 1 else {})
    answers = [executed("device", deadline, devices)]
    tell(answers[0])
    with concurrent.futures.ThreadPoolExecutor(places) as pool:
        waiting = [pool.submit(executed, task, deadline, devices) for task in tasks]
        for done in concurrent.futures.as_completed(waiting):
            answers.append(done.result())
            tell(answers[-1])
    date = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")
    about = {"date": date, "commit": (commit() or "unknown")[:7]}
    device = next((str(r["value"]) for r in answers[0]["rows"] if r["name"] == "device"), "unknown device")
    name = re.sub(r"[^a-z0-9]+", "_", device.lower()).strip("_")
    write([answer | about for answer in answers], options.folder / f"{name}.json")
    bad = [a["task"] for a in answers if failed(a)]
    print(f"{len(answers) - len(bad)} of {len(answers)} tasks passed" + (f"; failed: {', '.join(bad)}" if bad else ""))
    return 4 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
