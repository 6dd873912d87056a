"""Measures the drops of the sigma map, or with --sessile of the wetting map, on many cores; rows are kept as they come.

python scripts/measure_drops.py --jobs 16 --output rows.json [--models akinci,dong] [--dims 3] [--seconds 540]
What the map needs most comes first, the longest of it before the rest. A row that is there already is not measured
again, so that a stopped run goes on where it was.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def finite(value: object) -> object:
    """Strict JSON has no NaN."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write(path: Path, rows: dict[str, dict]) -> None:
    """One row a line, by key; until it is whole, the file of before stands."""
    lines = [f"{json.dumps(k)}: {json.dumps({n: finite(v) for n, v in rows[k].items()})}" for k in sorted(rows)]
    part = path.with_suffix(".part")
    part.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    os.replace(part, path)


def work(point: Any) -> dict:
    """One drop, in a process of its own."""
    return importlib.import_module(type(point).__module__).measure(point)


def measured(points: list[Any], jobs: int, seconds: float, keep: Callable[[dict], None]) -> None:
    """Measure the points in processes of their own until time is up; what is then unfinished is given up.

    A drop begins only if it should end in time by what those before it took.
    """
    began, waiting, running, paces = time.perf_counter(), list(points), {}, [1.0]
    with multiprocessing.get_context("spawn").Pool(jobs) as pool:
        while (left := seconds - (time.perf_counter() - began)) > 0:
            pace = statistics.median(paces)
            fitting = (p for p in waiting if pace * p.cost() < left)
            while len(running) < jobs and (point := next(fitting, None)):
                running[pool.apply_async(work, (point,))] = point
                waiting.remove(point)
                fitting = (p for p in waiting if pace * p.cost() < left)
            if not running:
                return
            for result in [r for r in running if r.ready()]:
                point, row = running.pop(result), result.get()
                if not row["stopped"] and row["seconds"] > 10:  # those below are compiling more than running
                    paces.append(row["seconds"] / point.cost())
                keep(row)
            time.sleep(0.02)
        print("time is up; unfinished: " + ", ".join(p.key for p in running.values()), flush=True)


def main() -> int:
    """Measure what is missing; prints one line for each row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--output", type=Path, help="validation/data/drops.json, or wetting.json there")
    parser.add_argument("--sessile", action="store_true", help="the drops of the wetting map, which sit on a plane")
    parser.add_argument("--cuda", action="store_true", help="the few drops that are measured on a GPU, too")
    parser.add_argument("--models", default="")
    parser.add_argument("--dims", default="2,3")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after so long")
    parser.add_argument("--limit", type=int, default=10**9, help="measure at most so many")
    options = parser.parse_args()
    os.environ["NUMBA_NUM_THREADS"] = "1"
    kind = importlib.import_module("validation.wetting" if options.sessile else "validation.drops")
    options.output = options.output or Path("validation/data") / ("wetting.json" if options.sessile else "drops.json")
    models = tuple(options.models.split(",")) if options.models else tuple(kind.MODELS)
    dims = tuple(int(d) for d in options.dims.split(","))
    rows = json.loads(options.output.read_text()) if options.output.exists() else {}
    wanted = list(kind.device_points() if options.cuda else kind.points(models, dims))
    missing = [p for p in wanted if p.key not in rows]
    if not options.cuda:  # those stand in the order in which they matter
        missing.sort(key=lambda p: (p.urgency(), p.cost() if options.jobs == 1 else -p.cost()))
    missing = missing[: options.limit]
    print(f"{len(missing)} drops to measure, {len(rows)} there", flush=True)
    options.output.parent.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    shown = ("angle", "circle") if options.sessile else ("laplace", "rayleigh")

    def keep(row: dict[str, Any]) -> None:
        rows[row["key"]] = row
        write(options.output, rows)
        first, second = (row.get(name, math.nan) for name in shown)
        words = f"{row['stopped'] or 'ok':<12} {first:7.3f} {second:7.3f} {row['seconds']:7.1f} s"
        print(f"{time.perf_counter() - began:5.0f}  {row['key']:<58} {words}", flush=True)

    measured(missing, options.jobs, options.seconds, keep)
    left = sum(p.key not in rows for p in wanted)
    print(f"{left} left; {time.perf_counter() - began:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())
