"""`python -m validation measure WHAT`: what takes hours or a machine of its own, and is kept on file.

Rows of drops are kept as they come, and a row that is there already is not measured again, so that a stopped run goes
on where it was. `sigma_map` and `wetting_map` condense them into the tables of `refsim.calibrate` and
`refsim.calibrate_contact_angle`.
"""

import argparse
import importlib
import json
import math
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from refsim.cluster import perform
from refsim.cluster.tasks import Task
from refsim.core.writing import write_file
from validation.results import finite

DATA = Path(__file__).resolve().parent.parent / "data"


def add_commands(made: argparse.ArgumentParser) -> None:
    """The subcommands."""
    commands = made.add_subparsers(dest="what", metavar="WHAT", required=True, parser_class=type(made))

    def add(name: str, words: str, module: str = "") -> argparse.ArgumentParser:
        """A command that `perform` of a module carries out, of this package's module of its name if left out."""
        part = commands.add_parser(name, help=words, description=f"{words[0].upper()}{words[1:]}.")
        where = module or f"validation.measure.{name}"
        part.set_defaults(perform=lambda given: importlib.import_module(where).perform(given) or 0)
        return part

    for name, about, file in (
        ("drops", "measures the free drops of the sigma map", "drops.json"),
        ("sessile", "measures the drops of the wetting map, which sit on a plane", "wetting.json"),
        ("tension", "measures the tension that acts in the default liquid over the asked one", "tension.json"),
    ):
        part = add(name, about)
        part.set_defaults(perform=measure_drops)
        where = part.add_mutually_exclusive_group()
        where.add_argument("--jobs", type=int, default=1, help="processes of one thread each")
        where.add_argument("--scheduler", metavar="ADDRESS", help="the workers of a Dask scheduler instead")
        part.add_argument("--output", type=Path, default=DATA / file, help=f"file of rows; validation/data/{file}")
        part.add_argument("--models", type=lambda text: tuple(text.split(",")), help="with commas; all by default")
        part.add_argument("--dims", type=lambda text: tuple(map(int, text.split(","))), default=(2, 3), help="or 2, 3")
        part.add_argument("--backend", default="cpu", help="cpu (default) or cuda")
        part.add_argument("--advanced", action="store_true", help="only drops of an advanced density")
        part.add_argument("--seconds", type=float, default=math.inf, help="stop after so long")
    for name, about in (
        ("sigma_map", "condenses the free drops on file into the table of refsim.calibrate"),
        ("wetting_map", "condenses the sessile drops on file into the table of refsim.calibrate_contact_angle"),
    ):
        part = add(name, about)
        part.set_defaults(perform=write_map)
        part.add_argument("--output", type=Path, help="the packaged table by default")
    part = add("studies", "holds refsim study against scenes with exact answers")
    part.add_argument("names", nargs="*", metavar="SCENE", help="all by default")
    part.add_argument("--backend", default="cpu", help="cpu (default) or cuda")
    part.add_argument("--threads", type=int, help="CPU threads; one for 1,024 particles by default")
    part.add_argument("--write", action="store_true", help="write the table into docs/study.md")
    part = add("liquid_price", "measures what a step of the liquid costs with each of its options (minutes)")
    part.add_argument("--backend", default="cpu", help="cpu (default) or cuda")
    part.add_argument("--threads", type=int, default=1, help="CPU threads (1)")
    part.add_argument("--output", type=Path, default=DATA / "liquid_price.json", help="file of the steps' seconds")
    part = add("waits", "measures how long import, advice and the first frame of a run take (a minute)")
    part.add_argument("--output", type=Path, default=DATA / "waits.json", help="file of their seconds")
    about = "computes the stored moments of the dam break anew (some minutes)"
    add("states", about, "validation.experiments.dam_break.scene")


def write(path: Path, rows: dict[str, dict]) -> None:
    """One row a line, by key; until it is whole, the file of before stands."""
    lines = [f"{json.dumps(k)}: {json.dumps({n: finite(v) for n, v in rows[k].items()})}" for k in sorted(rows)]
    write_file(path, "{\n" + ",\n".join(lines) + "\n}\n")


class TimeUp(Exception):
    """The seconds of a call are over."""


def work(report: Callable[[float], None], point: Any, backend: str) -> dict:
    """One drop, in a process of its own or by a worker of a scheduler."""
    return importlib.import_module(type(point).__module__).measure(point, backend)


def measured(
    points: list[Any], seconds: float, keep: Callable[[dict], None], jobs: int = 1, scheduler: str | None = None,
    backend: str = "cpu",
) -> None:  # fmt: skip
    """Measure the points until time is up; what is then unfinished is given up.

    Prints the efficiency, the sum of task seconds over workers x wall.
    """
    began, spent, most = time.perf_counter(), 0.0, 0
    tasks = [Task(p.key, p.key, work, (p, backend), p.cost()) for p in points]

    def watch(shares: Mapping[str, float], workers: int) -> None:
        nonlocal most
        most = max(most, workers)
        if time.perf_counter() - began > seconds:
            raise TimeUp

    try:
        for outcome in perform(tasks, jobs=jobs, scheduler=scheduler, watch=watch):
            if outcome.error is not None:
                print(f"{outcome.task.key}: {outcome.error}", flush=True)
                continue
            spent += outcome.seconds
            keep(outcome.value)
    except TimeUp:
        print("time is up", flush=True)
    wall = time.perf_counter() - began
    if most:
        print(f"{spent:.0f} s of {most} workers in {wall:.0f} s: efficiency {100 * spent / (most * wall):.0f} %")


def measure_drops(given: argparse.Namespace) -> int:
    """Measure what is missing, on many workers the longest first; prints one line for each row."""
    sessile = given.what == "sessile"
    os.environ["NUMBA_NUM_THREADS"] = "1"
    kind = importlib.import_module(f"validation.measure.{'wetting' if sessile else given.what}")
    rows = json.loads(given.output.read_text(encoding="utf-8")) if given.output.exists() else {}
    wanted = list(kind.points(tuple(given.models or kind.MODELS), given.dims))
    wanted = [p for p in wanted if p.liquid == "continuity"] if given.advanced else wanted
    missing = [p for p in wanted if p.key not in rows]
    missing.sort(key=lambda p: p.cost(), reverse=given.jobs > 1 or given.scheduler is not None)
    print(f"{len(missing)} drops to measure, {len(rows)} there", flush=True)
    given.output.parent.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    shown = ("angle", "circle") if sessile else ("laplace", "rayleigh")

    def keep(row: dict[str, Any]) -> None:
        rows[row["key"]] = row
        write(given.output, rows)
        first, second = (row.get(name, math.nan) for name in shown)
        row_text = f"{row['stopped'] or 'ok':<12} {first:7.3f} {second:7.3f} {row['seconds']:7.1f} s"
        print(f"{time.perf_counter() - began:5.0f}  {row['key']:<58} {row_text}", flush=True)

    measured(missing, given.seconds, keep, given.jobs, given.scheduler, given.backend)
    left = sum(p.key not in rows for p in wanted)
    print(f"{left} left; {time.perf_counter() - began:.0f} s")
    return 0


def write_map(given: argparse.Namespace) -> int:
    """Write a table from the rows on file."""
    from validation.measure.sigma_map import read_rows

    kind = importlib.import_module(f"validation.measure.{'wetting' if given.what == 'wetting_map' else 'sigma_map'}")
    rows, path = read_rows(kind.ROWS), given.output or kind.PACKAGED
    print(f"{len(rows)} drops, {kind.write(rows, path)} settings: {path.name}")
    return 0
