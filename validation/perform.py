"""Performing: what is not stored yet is computed, then judged and drawn from what is stored."""

import datetime
import gzip
import json
import math
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.backends.arrays import device_name
from refsim.cluster import perform as elsewhere
from refsim.cluster.tasks import Task
from refsim.core.errors import InputError, RunStopped
from refsim.core.terminal import Bar
from refsim.core.versions import commit, versions
from refsim.core.writing import write_file
from validation.checks import Check, failed
from validation.drawing import LONG_DATA, MEASURED, read_data, save_picture, shortened, style
from validation.experiment import Options, Part, Picture, RunSpec
from validation.reading import cores, processor
from validation.results import Result, finite, load, origin, result_folder, save
from validation.running import Context
from validation.tables import Table

PICTURE = 10.0  # [s] at most, to draw one
INTERRUPTED = "Interrupted: what was finished before is kept; the same command goes on from there."
EXIT_FINE, EXIT_INPUT, EXIT_STOPPED, EXIT_FAILED = 0, 2, 3, 4


@dataclass
class Performed:
    """What became of one part of an experiment."""

    part: Part
    results: dict[str, Result] = field(default_factory=dict)  # by the runs' keys, in the order of the runs
    checks: list[Check] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    drawn: dict[str, Path] = field(default_factory=dict)  # by the pictures' names
    skipped: dict[str, str] = field(default_factory=dict)  # why a run was left out
    stopped: dict[str, str] = field(default_factory=dict)
    reused: list[str] = field(default_factory=list)


Waiting = dict[Path, tuple[Part, RunSpec]]


def perform(
    parts: Sequence[Part], options: Options, jobs: int = 1, compute: bool = True,
    shown: Callable[[Path], None] = lambda picture: None, then: Sequence[Sequence[Part]] = (),
) -> list[Performed]:  # fmt: skip
    """Compute what is not stored, in `jobs` processes of one thread each or by the scheduler, check and draw.

    Runs that are timed have nothing else beside them. Runs of `then` begin when those of the parts before have ended.
    The first picture is drawn as soon as the results that it needs are there; others while processes compute or at the
    end, and again if more results have changed their data. `shown` is called with a picture's file each time.
    Without `compute`, only what is stored counts. Raises InputError where `only` names no run or a folder cannot be
    written to, RunStopped after Ctrl-C.
    """
    groups = (parts, *then)
    _refuse([part for group in groups for part in group], options, jobs)
    waiting: list[Waiting] = [{} for _ in groups]
    made = []
    for number, part in ((number, part) for number, group in enumerate(groups) for part in group):
        folders: dict[str, Path] = {}
        made.append((Performed(part), folders))
        for run in part.runs:
            if options.only and not run.key.startswith(options.only):
                continue
            folder = result_folder(options.results, part.folder, run.key, run.function, run.parameters)
            kept = run.skip or not options.fresh or not compute  # what is skipped, perhaps from a machine that can
            stored = load(folder) if kept else None
            if run.skip and stored is None:
                made[-1][0].skipped[run.key] = run.skip
                continue
            folders[run.key] = folder
            if stored is not None:
                made[-1][0].results[run.key] = stored
                made[-1][0].reused.append(run.key)
            elif run.alone or not any(folder in group for group in waiting):
                waiting[number][folder] = part, run
    ready: dict[tuple[str, str], tuple[Performed, Picture]] = {}  # to be drawn, by names of part and picture
    contents: dict[Path, bytes] = {}  # of the data files from which pictures have been drawn

    def draw(each: Performed, picture: Picture) -> None:
        data = write_data(picture, each.results, options.figures)
        content = data.read_bytes()
        if contents.get(data) != content:
            contents[data] = content
            each.drawn[picture.name] = redraw(picture, options.figures)
            shown(each.drawn[picture.name])

    def arrived(folder: Path) -> None:
        for each, folders in made:
            new = {key: load(folder) for key, where in folders.items() if where == folder}
            each.results |= {key: result for key, result in new.items() if result is not None}
            for picture in each.part.pictures if new else ():
                if picture.needs and set(picture.needs) <= set(each.results) and picture.name not in each.drawn:
                    ready[each.part.name, picture.name] = each, picture
        if not contents:
            draw_next()

    def draw_next() -> None:
        if ready:
            draw(*ready.pop(next(iter(ready))))

    stopped: dict[Path, str] = {}
    for group in waiting if compute else ():
        stopped |= _compute(group, options, jobs, arrived, draw_next)
    for each, folders in made:
        each.stopped |= {key: stopped[folder] for key, folder in folders.items() if folder in stopped}
        each.results = {key: each.results[key] for key in folders if key in each.results}
        each.checks = list(each.part.checks(each.results))
        each.tables = list(each.part.tables(each.results))
        for picture in each.part.pictures:
            if set(picture.needs) <= set(each.results):
                draw(each, picture)
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


def _compute(
    waiting: Waiting, options: Options, jobs: int, arrived: Callable[[Path], None], idle: Callable[[], None]
) -> dict[Path, str]:
    """Compute and store, and call `arrived` with the folder of each result; returns why runs stopped.

    `idle` is called when this process has time: while others compute or, where there are none, after each run.

    A run that fails in another process, but for one that stops with its reason, is computed again in this one, which
    reports the failure.
    """
    finished = 0
    with closing(Bar(sum(run.estimate for _, run in waiting.values()), shown=bool(waiting))) as bar:
        try:
            apart = jobs > 1 or options.scheduler is not None
            together = {folder: item for folder, item in waiting.items() if apart and not item[1].alone}
            done, stopped = set(), {}
            for folder, stop in _elsewhere(together, jobs, options.scheduler, bar.to, idle):
                done.add(folder)
                if stop is not None:
                    stopped[folder] = f"{stop} (reason: {stop.reason})"
                else:
                    finished += 1
                    arrived(folder)
            left = [(folder, item) for folder, item in waiting.items() if folder not in done]
            for folder, (part, run) in sorted(left, key=lambda item: item[1][1].alone):
                before = sum(waiting[folder][1].estimate for folder in done)
                name = f"{part.name} {run.key}"

                def progress(share: float, before: float = before, run: RunSpec = run, name: str = name) -> None:
                    bar.to(before + min(max(share, 0.0), 1.0) * run.estimate, name)

                progress(0.0)
                try:
                    compute(part.folder, run, folder, Context(progress, options.threads), part.command)
                    finished += 1
                    arrived(folder)
                    if not apart:
                        idle()
                except RunStopped as error:
                    stopped[folder] = f"{error} (reason: {error.reason})"
                progress(1.0)
                done.add(folder)
        except KeyboardInterrupt:
            kept = f"{finished} finished since the start are kept in {options.results}"
            kept = kept if finished else f"what {options.results} held before is kept"
            raise RunStopped("interrupted", f"Interrupted: {kept}; the same command goes on from there.") from None
    return stopped


def _elsewhere(
    waiting: Waiting, jobs: int, scheduler: str | None, show: Callable[[float, str], None], idle: Callable[[], None]
) -> Iterator[tuple[Path, RunStopped | None]]:
    """Compute in processes or on the workers of a scheduler; yields the folder of each result that is there.

    The first run begins first, and the others leave the processor to it, so that its picture is there soon.

    With the folder of a run that stopped it yields why. Meanwhile `show` is called with the names of the runs that are
    under way and with the estimated seconds done, and `idle` while no run waits to begin. Raises InputError if a worker
    has kept its result in another folder.
    """
    runs = {f"{part.folder}-{folder.name}": (folder, part, run) for folder, (part, run) in waiting.items()}
    tasks = [
        Task(
            key, f"{part.name} {run.key}", _compute_there,
            (part.folder, part.command, _plain(run), folder.resolve(), place > 0),
            run.estimate if place else math.inf, gpu=run.parameters.get("backend") == "cuda",
        )
        for place, (key, (folder, part, run)) in enumerate(runs.items())
    ]  # fmt: skip
    done, finished = 0.0, 0

    def watch(shares: Mapping[str, float], workers: int) -> None:
        seconds, names = done, []
        for key, (_, part, run) in runs.items():
            if key in shares:
                seconds += shares[key] * run.estimate
                names.append(f"{part.name} {run.key}" + (" (starts)" if shares[key] == 0.0 else ""))
        show(seconds, ", ".join(names))
        begun = finished + len(shares) == len(runs)
        if begun or min((runs[key][2].estimate for key in shares), default=0.0) > PICTURE:
            idle()

    for outcome in elsewhere(tasks, jobs=jobs, scheduler=scheduler, watch=watch):
        folder, _, run = runs[outcome.task.key]
        done, finished = done + run.estimate, finished + 1
        if isinstance(outcome.error, RunStopped):
            yield folder, outcome.error
        elif outcome.error is not None:
            print(f"{run.key}: {outcome.error}", file=sys.stderr)
        elif load(folder) is None:
            raise InputError(
                f"{outcome.task.name}: {outcome.worker} has kept its result elsewhere than in {folder}; give --results"
                " a folder that the workers and this machine share."
            )
        else:
            yield folder, None


def _plain(run: RunSpec) -> RunSpec:
    return RunSpec(run.key, run.function, dict(run.parameters))


YIELDING = 10  # niceness of what runs beside the first run


def _compute_there(
    report: Callable[[float], None], experiment: str, command: str, run: RunSpec, folder: Path, yielding: bool
) -> None:
    """Compute one run in another process. Raises InputError where that one has other sources."""
    if yielding and hasattr(os, "nice") and os.nice(0) < YIELDING:
        os.nice(YIELDING)
    here = result_folder(folder.parent.parent, experiment, run.key, run.function, run.parameters)
    if here.name != folder.name:
        raise InputError(f"{run.key}: the worker has other sources than the caller; give it the same ones.")
    compute(experiment, run, folder, Context(report, threads=1), command)


def compute(experiment: str, run: RunSpec, folder: Path, context: Context | None = None, command: str = "") -> None:
    """Compute one run and store its result, with when, where and with what that was, and how long it took."""
    context, began, spent = context or Context(threads=1), time.perf_counter(), time.process_time()
    result = run.function(context, **run.parameters)
    about = {
        "experiment": experiment, "run": run.key, "parameters": dict(run.parameters),
        "seconds": round(time.perf_counter() - began, 3), "command": command,
        "processor_seconds": round(time.process_time() - spent, 1),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"), "commit": commit(),
        "machine": machine(context.gpu()),
    }  # fmt: skip
    save(folder, Result(result.values, result.arrays, about))
    if load(folder) is None:
        raise OSError(f"{folder} cannot be read back")


def write_data(picture: Picture, results: Mapping[str, Any], folder: Path) -> Path:
    """Write the data of a picture, one key a line, in place of the file that is there; numbers with DIGITS digits,
    compressed (.json.gz) above LONG_DATA bytes. MEASURED says when, at which commit and where they were computed."""
    name, data = picture.name, shortened(finite(picture.collect(results)))
    behind = [results[key] for key in picture.needs or results]
    data |= {MEASURED: origin(behind)}
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in data.items()]
    text = "{\n" + ",\n".join(lines) + "\n}\n"
    folder.mkdir(parents=True, exist_ok=True)
    short, long = folder / f"{name}.json", folder / f"{name}.json.gz"
    compressed = len(text) > LONG_DATA
    path, other = (long, short) if compressed else (short, long)
    write_file(path, gzip.compress(text.encode(), 9, mtime=0) if compressed else text)
    other.unlink(missing_ok=True)
    return path


def redraw(picture: Picture, folder: Path) -> Path:
    """Draw a picture from its data file. Raises InputError where that is missing."""
    try:
        data = read_data(folder, picture.name)
    except (OSError, ValueError) as error:
        raise InputError(f"There is no data to draw {picture.name} from ({error}); run the experiment first.") from None
    path = folder / picture.file
    with style():
        figure = picture.draw(data)
        save_picture(figure, path)
        import matplotlib.pyplot as plt

        plt.close(figure)
    return path


def machine(gpu: bool = False) -> dict[str, Any]:
    """The machine in words, with its GPU where that was used, and the versions that compute."""
    numbers = {name: versions()[name] for name in ("python", "refsim", "numba", "numpy")}
    return {"processor": processor(), **({"gpu": device_name()} if gpu else {}), "cores": cores(), **numbers}


def exit_code(performed: Sequence[Performed]) -> int:
    """3 where a run stopped, else 4 where a check failed, else 0."""
    if any(each.stopped for each in performed):
        return EXIT_STOPPED
    return EXIT_FAILED if failed(check for each in performed for check in each.checks) else EXIT_FINE
