"""Performing: what is not stored yet is computed, then judged and drawn from what is stored."""

from __future__ import annotations

import datetime
import multiprocessing
import os
import platform
import signal
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TextIO

from refsim.backends.arrays import device_name
from refsim.core.errors import InputError, RunStopped
from validation.checks import Check, failed
from validation.drawing import redraw, write_data
from validation.experiment import Options, Part, Run
from validation.reading import processor
from validation.results import Result, load, result_folder, save
from validation.running import Context
from validation.tables import Table

EXIT_FINE, EXIT_INPUT, EXIT_STOPPED, EXIT_FAILED = 0, 2, 3, 4


@dataclass
class Performed:
    """What became of one part of an experiment."""

    part: Part
    results: dict[str, Result] = field(default_factory=dict)  # by the runs' keys, in the order of the runs
    checks: list[Check] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    drawn: list[Path] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)  # why a run was left out
    stopped: dict[str, str] = field(default_factory=dict)
    reused: list[str] = field(default_factory=list)


Waiting = dict[Path, tuple[Part, Run]]


def perform(
    parts: Sequence[Part], options: Options, jobs: int = 1, compute: bool = True, stream: TextIO | None = None
) -> list[Performed]:
    """Compute what is not stored, in `jobs` processes of one thread each, then check and draw.

    Runs that are timed have nothing else beside them. Without `compute`, only what is stored counts. Progress goes to
    `stream` (standard error). Raises InputError where `only` names no run or a folder cannot be written to,
    RunStopped after Ctrl-C.
    """
    _refuse(parts, options, jobs)
    waiting: Waiting = {}
    made = []
    for part in parts:
        folders: dict[str, Path] = {}
        made.append((Performed(part), folders))
        for run in part.runs:
            if options.only and not run.key.startswith(options.only):
                continue
            folder = result_folder(options.results, part.folder, run.key, run.function, run.parameters)
            stored = load(folder) if run.skip or not options.fresh else None  # perhaps from a machine that can
            if run.skip and stored is None:
                made[-1][0].skipped[run.key] = run.skip
                continue
            folders[run.key] = folder
            if stored is not None:
                made[-1][0].reused.append(run.key)
            elif folder not in waiting or run.alone:
                waiting[folder] = part, run
    stopped = _compute(waiting, options, jobs, stream or sys.stderr) if compute else {}
    for each, folders in made:
        for key, folder in folders.items():
            if folder in stopped:
                each.stopped[key] = stopped[folder]
            elif (stored := load(folder)) is not None:
                each.results[key] = stored
        each.checks = list(each.part.checks(each.results))
        each.tables = list(each.part.tables(each.results))
        for picture in each.part.pictures:
            if set(picture.needs) <= set(each.results):
                write_data(picture, each.results, options.figures)
                each.drawn.append(redraw(picture, options.figures))
    return [each for each, _ in made]


def _refuse(parts: Sequence[Part], options: Options, jobs: int) -> None:
    """Raises InputError for what would otherwise show after minutes of computing."""
    if jobs < 1:
        raise InputError(f"--jobs = {jobs} is not possible; give 1 or more processes.")
    if options.only:
        keys = list(dict.fromkeys(run.key for part in parts for run in part.runs))
        some = ", ".join(keys[:20]) + (", ..." if len(keys) > 20 else "")
        for start in options.only:
            if not any(key.startswith(start) for key in keys):
                raise InputError(f"There is no run whose name starts with {start!r}; choose from {some}.")
    for what, folder in (("results", options.results), ("figures", options.figures)):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError as error:
            why = error.strerror or error
            raise InputError(
                f"The folder {folder} for {what} cannot be written to ({why}); make it writable, or give another"
                f" (--{what})."
            ) from None


def _compute(waiting: Waiting, options: Options, jobs: int, stream: TextIO) -> dict[Path, str]:
    """Compute and store; returns why runs stopped. What fails in a process is computed again here, to say so."""
    from tqdm import tqdm

    layout = "{desc} {percentage:3.0f}% |{bar}| {elapsed} gone, about {remaining} left"
    total = sum(run.estimate for _, run in waiting.values())
    pause = 0.5 if stream.isatty() else 5.0
    finished = 0
    with tqdm(total=total, file=stream, bar_format=layout, disable=not waiting, mininterval=pause) as bar:
        try:
            together = {folder: item for folder, item in waiting.items() if jobs > 1 and not item[1].alone}
            done = set()
            for folder in _in_processes(together, jobs):
                bar.update(waiting[folder][1].estimate)
                done.add(folder)
                finished += 1
            left = [(folder, item) for folder, item in waiting.items() if folder not in done]
            stopped = {}
            for folder, (part, run) in sorted(left, key=lambda item: item[1][1].alone):
                bar.set_description_str(f"{part.name} {run.key}")
                before = bar.n

                def progress(share: float, before: float = before, run: Run = run) -> None:
                    at = before + min(max(share, 0.0), 1.0) * run.estimate
                    bar.update(max(at - bar.n, 0.0))

                try:
                    compute(part.folder, run, folder, Context(progress, options.threads))
                    finished += 1
                except RunStopped as error:
                    stopped[folder] = f"{error} (reason: {error.reason})"
                progress(1.0)
        except KeyboardInterrupt:
            kept = f"{finished} finished since the start are kept in {options.results}"
            kept = kept if finished else f"what {options.results} held before is kept"
            raise RunStopped("interrupted", f"Interrupted: {kept}; the same command goes on from there.") from None
    return stopped


def _in_processes(waiting: Waiting, jobs: int) -> Iterator[Path]:
    """Compute in processes, the longest first; yields the folder of each result that is there."""
    if not waiting:
        return
    spawn = multiprocessing.get_context("spawn")  # a forked process would inherit the threads of Numba's pool
    with ProcessPoolExecutor(min(jobs, len(waiting)), mp_context=spawn, initializer=_one_thread) as pool:
        order = sorted(waiting.items(), key=lambda item: -item[1][1].estimate)
        futures = {pool.submit(compute, part.folder, _plain(run), folder): folder for folder, (part, run) in order}
        try:
            for done in as_completed(futures):
                if (error := done.exception()) is None:
                    yield futures[done]
                else:
                    print(f"{waiting[futures[done]][1].key}: {error}", file=sys.stderr)
        except (KeyboardInterrupt, GeneratorExit):
            pool.shutdown(wait=True, cancel_futures=True)
            raise


def _plain(run: Run) -> Run:
    return Run(run.key, run.function, dict(run.parameters))


def _one_thread() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends it without words; the parent says what is kept
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"  # before Numba is loaded


def compute(experiment: str, run: Run, folder: Path, context: Context | None = None) -> None:
    """Compute one run and store its result, with when, where and with what that was."""
    context, began = context or Context(threads=1), time.perf_counter()
    result = run.function(context, **run.parameters)
    about = {
        "experiment": experiment,
        "run": run.key,
        "parameters": dict(run.parameters),
        "seconds": round(time.perf_counter() - began, 3),
        "seconds_compiling": round(context.compile_seconds(), 3),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "machine": machine(context.gpu()),
    }
    save(folder, Result(result.values, result.arrays, about))
    if load(folder) is None:
        raise OSError(f"{folder} cannot be read back")


def machine(gpu: bool = False) -> dict[str, Any]:
    """The machine in words, with its GPU where that was used, and the versions that compute."""
    import numba
    import numpy

    import refsim

    return {
        "processor": processor(),
        **({"gpu": device_name()} if gpu else {}),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "python": platform.python_version(),
        "refsim": refsim.__version__,
        "numba": numba.__version__,
        "numpy": numpy.__version__,
    }


def exit_code(performed: Sequence[Performed]) -> int:
    """3 where a run stopped, else 4 where a check failed, else 0."""
    if any(each.stopped for each in performed):
        return EXIT_STOPPED
    return EXIT_FAILED if failed(check for each in performed for check in each.checks) else EXIT_FINE
