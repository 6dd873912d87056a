"""Sweeps: a scene's observable at a grid or a list of parameters, with seeds, on many processes or machines.

Contents: Sweep, read_sweep, sweep, Swept, Progress.
"""

import copy
import csv
import errno
import io
import itertools
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from refsim.backends.arrays import require_backend
from refsim.cluster import perform
from refsim.cluster.tasks import Outcome, Task
from refsim.core.errors import InputError
from refsim.core.tables import in_time, table
from refsim.core.terminal import Bar
from refsim.core.writing import in_turn, replace_file, writing
from refsim.io.store import tidy
from refsim.scene.files import load_scene, scene_from_dict, scene_to_dict, set_parameter, struct_of, tables_of, text_of
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.study import runs
from refsim.study.observables import Observable, observable_of
from refsim.study.runs import Reading, Setting
from refsim.study.tasks import task_of, whole_name

MOST_RUNS = 1_000_000
TABLE = "sweep.csv"
KEPT = "finished runs are kept"
SEED = "seed"
ANYWHERE = "anywhere"  # a value does not depend on where it was computed; its seconds are not compared


class Sweep(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a sweep file says.

    scene       path of a scene file, from the folder of the sweep file
    observable  as for `refsim study`; its value at the scene's end_time
    backend     "cpu", "cuda" or "numpy"
    grid        {parameter: values}; every combination is a run
    points      tables {parameter: value}; each is a run, with every combination of the grid
    seeds       each run is repeated with every `seed` of the scene set to each of these
    """

    scene: str
    observable: str
    backend: str = "cpu"
    grid: dict[str, list[Any]] = {}
    points: list[dict[str, Any]] = []
    seeds: list[int] = []


class Point(NamedTuple):
    """One run of a sweep: what it sets, {parameter: value}, the same in words, and the scene that follows."""

    values: Mapping[str, Any]
    label: str
    scene: Scene


@dataclass(frozen=True)
class Swept:
    """What a sweep gave.

    readings      of the points, in their order; None where a run was not computed, for the reason in `missing`
    computed      runs that were computed now; the others were on file, or are missing
    task_seconds  sum over the runs computed now; `wall` of the whole call [s]
    workers       most of them at one time
    notes         a sentence for each damaged result that was found
    """

    points: tuple[Point, ...]
    readings: tuple[Reading | None, ...]
    observable: Observable
    computed: int
    missing: Mapping[int, str]
    task_seconds: float
    wall: float
    workers: int
    notes: tuple[str, ...] = ()

    @property
    def efficiency(self) -> float:
        """Sum of task seconds over workers x wall; NaN if nothing was computed."""
        return self.task_seconds / (self.workers * self.wall) if self.workers and self.wall else math.nan

    def rows(self) -> list[dict[str, Any]]:
        """A dictionary for each run: parameters, value, seconds (of the processor, on a GPU of the clock), particles,
        steps and, without a value, the reason.
        """
        rows = []
        for k, (point, reading) in enumerate(zip(self.points, self.readings)):
            reason = self.missing[k] if reading is None else reading.failed
            found = {name: getattr(reading, name, None) for name in ("value", "seconds", "particles", "steps")}
            rows.append({**point.values, **found, **({"value": None} if reason else {}), "reason": reason})
        return rows

    def csv(self) -> str:
        """The rows as comma-separated values with a head."""
        text, rows = io.StringIO(), self.rows()
        writer = csv.DictWriter(text, list(dict.fromkeys(name for row in rows for name in row)), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
        return text.getvalue()

    def text(self) -> str:
        """The rows as a table, the reasons below it, and what it took."""
        names = list(dict.fromkeys(name for point in self.points for name in point.values))
        unit = f" [{self.observable.unit}]" if self.observable.unit else ""
        found = self.rows()
        told = (("value", ".6g"), ("seconds", ".3g"))
        rows = [
            [*(row.get(n, "") for n in names), *("-" if row[n] is None else f"{row[n]:{digits}}" for n, digits in told)]
            for row in found
        ]
        reasons = [f"{point.label}: {row['reason']}" for point, row in zip(self.points, found) if row["reason"]]
        head = (*names, f"{self.observable.name}{unit}", "seconds")
        failed = sum(1 for reading in self.readings if reading is not None and reading.failed)
        sums = f"{len(self.points)} runs, {self.computed} of them computed now"
        sums += f", {failed} without a value" if failed else ""
        sums += f", {len(self.missing)} not computed" if self.missing else ""
        notes = (f"note: {note}" for note in self.notes)
        lines = [table(rows, head, right=range(len(head))), "", *reasons, *notes, sums]
        if self.computed:
            lines.append(
                f"{in_time(self.task_seconds)} of {self.workers} workers in {in_time(self.wall)}: efficiency"
                f" {100 * self.efficiency:.0f} %"
            )
        return "\n".join(lines)

    def data(self) -> dict[str, Any]:
        """The same as plain values, for JSON."""
        data: dict[str, Any] = {"observable": self.observable.name, "unit": self.observable.unit, "runs": self.rows()}
        data |= {name: getattr(self, name) for name in ("computed", "task_seconds", "workers", "efficiency")}
        return data | {"wall_seconds": self.wall, "notes": list(self.notes)}


def read_sweep(path: str | os.PathLike[str]) -> Sweep:
    """The sweep in a TOML file. Raises InputError where it cannot be read or says something impossible."""
    parsed: Sweep = struct_of(Sweep, tables_of(text_of(Path(path), "sweep file"), str(path)), str(path))
    return parsed


def points_of(given: Sweep, folder: Path, source: str) -> list[Point]:
    """All runs of a sweep. Raises InputError for a parameter or a value that its scene does not have."""
    base = scene_to_dict(load_scene(os.path.realpath(folder / given.scene)))
    for name, values in given.grid.items():
        if not values:
            raise InputError(f"{source}: [grid] gives no value for {name!r}; give at least one.")
    axes = given.grid | ({SEED: given.seeds} if given.seeds else {})
    count = math.prod(map(len, axes.values())) * max(len(given.points), 1)
    if count > MOST_RUNS:
        raise InputError(f"{source}: it has {count:,} runs; give at most {MOST_RUNS:,}.")
    points = []
    for listed, values in itertools.product(given.points or [{}], itertools.product(*axes.values())):
        chosen = listed | dict(zip(axes, values))
        tables = copy.deepcopy(base)
        seeded = [effect for effect in tables["effects"].values() if SEED in effect]
        if SEED in chosen and not seeded:
            raise InputError(f"{source}: no effect of the scene has a {SEED!r}: seeds change nothing; leave them out.")
        for name, value in chosen.items():
            for effect in seeded if name == SEED else ():
                effect[SEED] = value
            if name != SEED:
                set_parameter(tables, name, value, source)
        said = ", ".join(f"{name} = {value}" for name, value in chosen.items())
        scene = scene_from_dict(tables, f"{source}: {given.scene} with {said}")
        points.append(Point(chosen, said or scene.name, scene))
    return points


def sweep(
    path: str | os.PathLike[str],
    *,
    folder: str | os.PathLike[str],
    jobs: int | None = None,
    scheduler: str | None = None,
    checkpoint_every: float = 60.0,
    say: Callable[[str], None] = lambda text: None,
    bar: bool = False,
) -> Swept:
    """Compute the runs of a sweep file that are not in the folder yet, and return them all.

    folder            of results, one file for each run, named by the digest of all that its value follows from; the
                      workers write there, so that it must be the same folder for all of them
    jobs              processes of this machine, of one thread each; as many as it has processors by default
    scheduler         address of a Dask scheduler, whose workers compute instead
    checkpoint_every  seconds of wall time between two checkpoints of a run
    say, bar          lines of progress, and whether to show a bar

    A run that diverges is a result with its reason. Raises InputError for bad input, RunStopped("scheduler_lost")
    where the scheduler goes away.
    """
    given, place, began = read_sweep(path), Path(folder), time.perf_counter()
    if not checkpoint_every > 0:
        raise InputError(f"--checkpoint-every = {checkpoint_every:g} is not possible; give a positive number [s].")
    if scheduler is None or given.backend != "cuda":
        require_backend(given.backend)
    points = points_of(given, Path(path).parent, str(path))
    file, _, function = given.observable.rpartition(":")  # the file stands relative to the sweep file
    name = whole_name(f"{Path(path).parent / file}:{function}") if file.endswith(".py") else given.observable
    observable = observable_of(name, _first_plan(points))
    settings = [Setting("sweep", point.label, 1.0, point.scene, given.backend) for point in points]
    notes: list[str] = []
    keys = [runs.key_of(setting, observable, None, 1, ANYWHERE) for setting in settings]
    readings: dict[str, Reading | None] = {key: runs.kept(place, key, notes) for key in keys}
    left = {key: setting for key, setting in zip(keys, settings) if readings[key] is None}
    tasks = [task_of(key, setting, name, place, checkpoint_every) for key, setting in left.items()]
    on_file, missing = len(readings) - len(left), dict[str, str]()
    say(f"{len(left)} runs to do" + (f", {on_file} are on file" if on_file else ""))
    if tasks:
        _writable(place)
        tidy(place)
    progress = Progress(tasks, bar, say)
    with (
        closing(progress.bar),
        closing(perform(tasks, jobs=jobs, scheduler=scheduler, watch=progress.watch, say=say)) as outcomes,
    ):
        for outcome in outcomes:
            key = outcome.task.key
            stored = runs.kept(place, key, notes)  # also where another process has computed it meanwhile
            if stored is None and outcome.error is None:  # the worker's folder is another one
                runs.keep(place, key, left[key], outcome.value)
            readings[key] = stored or outcome.value
            if readings[key] is None:
                missing[key] = " ".join(str(outcome.error).split())
            progress.ended(outcome)
    for key in missing:  # another process may have computed it since
        readings[key] = readings[key] or runs.kept(place, key, notes)
    lacking = {k: missing[key] for k, key in enumerate(keys) if readings[key] is None}
    found, took = tuple(readings[key] for key in keys), (progress.task_seconds, time.perf_counter() - began)
    computed = sum(readings[key] is not None for key in left)
    swept = Swept(tuple(points), found, observable, computed, lacking, *took, progress.workers, tuple(notes))
    _writable(place)
    with writing("table", place / TABLE, KEPT), in_turn(place / f"{TABLE}.lock"):
        replace_file(place / TABLE, swept.csv().encode())
    return swept


def _first_plan(points: list[Point]) -> Any:
    """The plan of the first point that has one. Raises InputError where none has."""
    for point in points[:-1]:
        with suppress(InputError):
            return make_plan(point.scene)
    return make_plan(points[-1].scene)


def _writable(folder: Path) -> None:
    with writing("folder", folder, KEPT):
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


# Progress of a sweep


class Progress:
    """A bar over the weight of tasks, and a line for each that ends.

    task_seconds  sum of the seconds of ended tasks
    workers       most workers seen at one time
    """

    def __init__(self, tasks: Sequence[Task], shown: bool, say: Callable[[str], None]) -> None:
        least = max((task.weight for task in tasks), default=1.0) / 1000 or 1.0
        self.weights = {task.key: max(task.weight, least) for task in tasks}
        self.total, self.say = sum(self.weights.values()), say
        self.done, self.count = 0.0, 0
        self.task_seconds, self.workers, self.began = 0.0, 0, time.perf_counter()
        self.bar = Bar(1.0, shown=shown and bool(tasks))

    def watch(self, shares: Mapping[str, float], workers: int) -> None:
        """The shares done of tasks under way."""
        self.workers = max(self.workers, workers)
        share = (self.done + sum(self.weights[key] * s for key, s in shares.items())) / self.total
        self.bar.to(share, f"{workers} workers, {in_time(self.task_seconds)} of theirs so far")

    def ended(self, outcome: Outcome) -> None:
        """A task has ended."""
        task, reading = outcome.task, outcome.value
        self.count += 1
        self.done += self.weights[task.key]
        self.task_seconds += outcome.seconds
        gone = time.perf_counter() - self.began
        left = gone * (self.total - self.done) / self.done
        said = f"not computed: {outcome.error}"
        if outcome.error is None:
            said = reading.failed or f"{reading.value:.6g} in {in_time(outcome.seconds)}"
        rest = f"; about {in_time(left)} left" if self.count < len(self.weights) else ""
        self.say(f"{self.count} of {len(self.weights)}, {task.name}: {said}{rest}")
