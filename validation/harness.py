"""The harness: finds cases, runs what is not stored yet, judges, draws from stored files, and reports.

A case lists its runs; a run is a function of plain parameters whose result is stored under them. Judging and drawing
read stored results only.
"""

from __future__ import annotations

import datetime
import difflib
import gzip
import importlib
import json
import os
import pkgutil
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any, TextIO

from refsim.backends.arrays import device_name
from refsim.core.errors import InputError, RunStopped
from validation import cases as case_folder
from validation.results import Result, finite, load, read_json, result_folder, save
from validation.running import Context
from validation.tables import Table, verdict_table
from validation.verdicts import Measurement, failed

Results = Mapping[str, Result]
EXIT_FINE, EXIT_INPUT, EXIT_STOPPED, EXIT_FAILED = 0, 2, 3, 4

LONG_DATA = 10_000  # bytes of a picture's data above which its file is compressed


@dataclass(frozen=True)
class Options:
    """What the user asks for.

    quick    the small sizes of `reproduce.py --quick`, otherwise the published ones
    peers    also run other programs on the same work
    fresh    compute anew what is stored
    only     runs whose keys start like one of these; all without
    """

    quick: bool = False
    backend: str = "cpu"
    peers: bool = False
    fresh: bool = False
    threads: int | None = None
    results: Path = Path("results")
    figures: Path = Path("figures")
    only: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """One computation: `function(context, **parameters)`, stored under `key` and the digest of its parameters.

    estimate  seconds it may take, for the progress bar
    skip      why it is left out, if it is
    """

    key: str
    function: Callable[..., Result]
    parameters: Mapping[str, Any] = field(default_factory=dict)
    estimate: float = 1.0
    skip: str = ""


@dataclass(frozen=True)
class Picture:
    """A picture and the data it is drawn from: `collect` gives what JSON takes, `draw` makes a figure of that alone.

    `shaded` pictures (rendered surfaces, thousands of particles) are stored as WebP, plots as PNG with a palette.
    """

    name: str
    collect: Callable[[Results], Mapping[str, Any]]
    draw: Callable[[Mapping[str, Any]], Any]
    needs: tuple[str, ...] = ()
    shaded: bool = False

    @property
    def file(self) -> str:
        """Name of its file."""
        return f"{self.name}.webp" if self.shaded else f"{self.name}.png"


@dataclass(frozen=True)
class Case:
    """One experiment.

    runs      what is to be computed under the options
    judge     measurements with verdicts, from the results that are there
    pictures  drawn where all results that they need are there
    tables    further tables, from the results that are there
    """

    name: str
    title: str
    runs: Callable[[Options], Sequence[Run]]
    judge: Callable[[Results], Sequence[Measurement]]
    pictures: tuple[Picture, ...] = ()
    tables: Callable[[Results], Sequence[Table]] = lambda results: ()


@dataclass
class Outcome:
    """What became of one case."""

    case: Case
    results: dict[str, Result] = field(default_factory=dict)
    measurements: list[Measurement] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    drawn: list[Path] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    stopped: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)  # of the runs computed now
    compiling: dict[str, float] = field(default_factory=dict)  # of these, starting and compiling
    reused: list[str] = field(default_factory=list)


def discover(folder: ModuleType = case_folder) -> dict[str, Case]:
    """The cases by name: every module of `folder` that exports a `CASE`, in alphabetical order."""
    found = {}
    for entry in pkgutil.iter_modules(folder.__path__):
        case = getattr(importlib.import_module(f"{folder.__name__}.{entry.name}"), "CASE", None)
        if case is not None:
            found[case.name] = case
    return found


def chosen_cases(names: Sequence[str], cases: Mapping[str, Case], what: str = "case") -> list[Case]:
    """The named cases, or all. Raises InputError for a name that there is not."""
    for name in names:
        if name not in cases:
            near = difflib.get_close_matches(name, cases, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"choose one of {', '.join(cases)}."
            raise InputError(f"There is no {what} {name!r}; {hint}")
    return [cases[name] for name in names or cases]


def perform(cases: Sequence[Case], options: Options, stream: TextIO | None = None) -> list[Outcome]:
    """Compute what is not stored, then judge and draw. Progress goes to `stream` (standard error).

    Raises InputError where `only` names no run or a folder cannot be written to, RunStopped after Ctrl-C.
    """
    stream = stream or sys.stderr
    outcomes, waiting = [], []
    check(cases, options)
    for case in cases:
        outcome = Outcome(case)
        outcomes.append(outcome)
        for run in case.runs(options):
            if options.only and not run.key.startswith(options.only):
                continue
            folder = result_folder(options.results, case.name, run.key, run.function, run.parameters)
            stored = load(folder) if run.skip or not options.fresh else None  # perhaps from a machine that can
            if run.skip and stored is None:
                outcome.skipped[run.key] = run.skip
            elif stored is None:
                waiting.append((outcome, run, folder))
            else:
                outcome.results[run.key] = stored
                outcome.reused.append(run.key)
    _compute(waiting, options, stream)
    for outcome in outcomes:
        outcome.measurements = list(outcome.case.judge(outcome.results))
        outcome.tables = list(outcome.case.tables(outcome.results))
        for picture in outcome.case.pictures:
            if set(picture.needs) <= set(outcome.results):
                write_data(picture, outcome.results, options.figures)
                outcome.drawn.append(redraw(picture, options.figures))
    return outcomes


def check(cases: Sequence[Case], options: Options) -> None:
    """Raises InputError for what would otherwise show after minutes of computing."""
    if options.only:
        keys = list(dict.fromkeys(run.key for case in cases for run in case.runs(options)))
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


def interrupted(done: int, results: Path) -> RunStopped:
    """What Ctrl-C comes to: whole results are kept, and the same command goes on after them."""
    kept = f"{done} finished since the start are kept in {results}" if done else f"what {results} held before is kept"
    return RunStopped("interrupted", f"Interrupted: {kept}; the same command goes on from there.")


def _compute(waiting: Sequence[tuple[Outcome, Run, Path]], options: Options, stream: TextIO) -> None:
    from tqdm import tqdm

    total = sum(run.estimate for _, run, _ in waiting)
    layout = "{desc} {percentage:3.0f}% |{bar}| {elapsed} gone, about {remaining} left"
    bar = tqdm(
        total=total, file=stream, bar_format=layout, disable=not waiting, mininterval=0.5 if stream.isatty() else 5.0
    )
    width = max((len(f"{o.case.name} {run.key}") for o, run, _ in waiting), default=0)
    done, finished = 0.0, 0
    with bar:
        for outcome, run, folder in waiting:
            bar.set_description_str(f"{outcome.case.name} {run.key}".ljust(width))

            def progress(share: float, done: float = done, run: Run = run) -> None:
                at = done + min(max(share, 0.0), 1.0) * run.estimate
                if at > bar.n:
                    bar.update(at - bar.n)

            context = Context(progress, options.threads)
            began = time.perf_counter()
            try:
                result = run.function(context, **run.parameters)
            except RunStopped as error:
                outcome.stopped[run.key] = f"{error} (reason: {error.reason})"
                result = None
            except KeyboardInterrupt:
                raise interrupted(finished, options.results) from None
            seconds = time.perf_counter() - began
            outcome.seconds[run.key] = seconds
            outcome.compiling[run.key] = context.compile_seconds()
            if result is not None:
                about = about_run(outcome.case.name, run, seconds, context)
                save(folder, Result(result.values, result.arrays, about))
                stored = load(folder)
                if stored is None:
                    raise OSError(f"{folder} cannot be read back")
                outcome.results[run.key] = stored
                finished += 1
            done += run.estimate
            progress(0.0, done)


def about_run(case: str, run: Run, seconds: float, context: Context) -> dict[str, Any]:
    """When, where and with what a result was computed."""
    return {
        "case": case,
        "run": run.key,
        "parameters": dict(run.parameters),
        "seconds": round(seconds, 3),
        "seconds_compiling": round(context.compile_seconds(), 3),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d"),
        "machine": machine(context.gpu()),
    }


def machine(gpu: bool = False) -> dict[str, Any]:
    """The machine in words, with its GPU where that was used, and the versions that compute."""
    import numba
    import numpy

    import refsim

    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return {
        "processor": name,
        **({"gpu": device_name()} if gpu else {}),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "python": platform.python_version(),
        "refsim": refsim.__version__,
        "numba": numba.__version__,
        "numpy": numpy.__version__,
    }


# Pictures


def write_data(picture: Picture, results: Results, folder: Path) -> Path:
    """Write the data of a picture, one key a line; compressed (.json.gz) above LONG_DATA bytes."""
    data = finite(picture.collect(results))
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in data.items()]
    return store_data(folder, picture.name, "{\n" + ",\n".join(lines) + "\n}\n")


def store_data(folder: Path, name: str, text: str) -> Path:
    """Write a picture's data file in place of the one that is there."""
    folder.mkdir(parents=True, exist_ok=True)
    short, long = folder / f"{name}.json", folder / f"{name}.json.gz"
    compressed = len(text) > LONG_DATA
    path, other = (long, short) if compressed else (short, long)
    path.write_bytes(gzip.compress(text.encode(), 9, mtime=0) if compressed else text.encode())
    other.unlink(missing_ok=True)
    return path


def read_data(folder: Path, name: str) -> Any:
    """Data of a picture. Raises OSError or ValueError where there is no such file, or another."""
    long = folder / f"{name}.json.gz"
    return read_json(long if long.exists() else folder / f"{name}.json")


def redraw(picture: Picture, folder: Path) -> Path:
    """Draw a picture from its data file. Raises InputError where that is missing."""
    from validation.drawing import save_picture, style

    try:
        data = read_data(folder, picture.name)
    except (OSError, ValueError) as error:
        raise InputError(f"There is no data to draw {picture.name} from ({error}); run the case first.") from None
    path = folder / picture.file
    with style():
        figure = picture.draw(data)
        save_picture(figure, path)
        import matplotlib.pyplot as plt

        plt.close(figure)
    return path


# Reports


def report(outcomes: Sequence[Outcome], stream: TextIO) -> None:
    """Write all tables; the verdicts come last."""
    for outcome in outcomes:
        for table in outcome.tables:
            print(f"\n{table}", file=stream)
    notes = []
    for outcome in outcomes:
        name = outcome.case.name
        for why in dict.fromkeys(outcome.skipped.values()):
            keys = [key for key, reason in outcome.skipped.items() if reason == why]
            notes.append(f"{name}: left out {', '.join(keys)} ({why})")
        notes += [f"{name}: {key} stopped. {why}" for key, why in outcome.stopped.items()]
        if outcome.reused:
            dates = sorted({str(outcome.results[key].about.get("date")) for key in outcome.reused})
            notes.append(
                f"{name}: reused {', '.join(outcome.reused)}, computed on {' and '.join(dates)} (--fresh computes anew)"
            )
    seconds = sum(sum(o.seconds.values()) for o in outcomes)
    compiling = sum(sum(o.compiling.values()) for o in outcomes)
    if seconds:
        notes.append(
            f"Computing took {seconds:.1f} s; of these, {compiling:.1f} s went into starting, and compiling or loading"
            " kernels."
        )
    if notes:
        print("\n" + "\n".join(notes), file=stream)
    judged = [(o.case.name, m) for o in outcomes for m in o.measurements]
    if judged:
        print("\n" + verdict_table(judged), file=stream)


def as_json(outcomes: Sequence[Outcome]) -> str:
    """One object: every measurement by name, with the case in front where several cases ran."""
    several = len(outcomes) > 1
    judged = {f"{o.case.name}.{m.name}" if several else m.name: m.plain() for o in outcomes for m in o.measurements}
    return json.dumps(judged, indent=1, allow_nan=False)


def exit_code(outcomes: Sequence[Outcome]) -> int:
    """3 where a run stopped, else 4 where a verdict failed, else 0."""
    if any(o.stopped for o in outcomes):
        return EXIT_STOPPED
    return EXIT_FAILED if failed(m for o in outcomes for m in o.measurements) else EXIT_FINE
