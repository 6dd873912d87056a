"""One run of a study: its value of the observable, what it took, and its place on disk."""

import dataclasses
import functools
import hashlib
import json
import math
import platform
import time
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import msgspec

import refsim.core
from refsim.core.errors import InputError, RunStopped
from refsim.core.reading import open_regular
from refsim.core.tables import in_time
from refsim.core.versions import versions
from refsim.core.writing import in_turn, plain, replace_file
from refsim.engine.simulation import Simulation
from refsim.io.checkpoint import CHECKPOINT
from refsim.io.store import read_stored, set_aside, write_stored
from refsim.scene.files import scene_to_toml
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.study.cost import bytes_of
from refsim.study.observables import Observable, Watching, observable_of

NOT_READ = ("cluster", "commands", "contract", "render", "study", "sweep")  # packages that change no result of a run
BUT_READ = ("study/observables.py", "study/runs.py")  # modules of theirs that do
NOT_OF_THE_RUN = ("interrupted", "disk_full", "write_failed", "out_of_memory")  # reasons to stop that lie elsewhere
CLOCK = "clock.json"  # beside a checkpoint: the seconds that its steps took
SHORT = 1.0  # [s] of a run below which its seconds are read several times
REPEATS = 6
SETTLED = 0.05  # relative difference of the two least seconds of repeats, from which on they have not settled
SAMPLES = 400  # of a run in which an observable is to reach a value
Watch = Callable[[Simulation], None]


@dataclasses.dataclass(frozen=True)
class Setting:
    """One run that a study needs."""

    kind: str  # what differs from the user's scene; "spacing" also of the scene itself
    label: str  # in tables
    factor: float  # the scene's spacing over this one
    scene: Scene
    backend: str


@dataclasses.dataclass(frozen=True)
class Reading:
    """What a run gave."""

    value: float = math.nan  # of the observable; NaN where the run failed
    seconds: float = 0.0  # of the processor that its steps took, without compiling; of the clock on a GPU
    wall: float = 0.0  # the same of the clock
    bytes: int = 0  # of fields, lists and walls, from the plan
    particles: int = 0
    steps: int = 0
    time: float = 0.0
    rebuilds: int = 0
    failed: str = ""  # one sentence if there is no value; "" otherwise
    mass: float = 0.0  # of all particles at its start [kg; kg/m in 2D]
    unsettled: str = ""  # why its seconds are not to be trusted; "" where they are

    def __str__(self) -> str:
        return self.failed or f"{self.value:.6g} in {in_time(self.seconds)}"


def measure(
    setting: Setting, given: Observable | str, reaches: float | None = None, threads: int | None = None,
    progress: Watch | None = None, repeats: int = REPEATS, checkpoints: Path | None = None, every: float = 60.0,
) -> Reading:  # fmt: skip
    """Run a setting to the scene's end, or until the observable reaches `reaches`, and read the observable.

    given        the observable, or as a text
    repeats      most runs of a short setting
    checkpoints  folder in which the run leaves a checkpoint after every `every` seconds of wall time and from which it
                 goes on, bit for bit; a run with `reaches`, or with an observable that watches it, begins anew

    The value belongs to the end time itself: it is interpolated between the steps before and after. With `reaches` it
    is the time at which the observable has that value, interpolated between its samples.

    A run of less than `SHORT` seconds is repeated until its two least seconds agree within `SETTLED`, up to `repeats`
    times in all, and the least count; where they do not agree, the reading says so.
    A run that cannot be made or stops gives a Reading with the sentence why. Raises RunStopped for a reason of
    `NOT_OF_THE_RUN`, which says nothing about the setting.
    """
    try:
        observable = observable_of(given, make_plan(setting.scene)) if isinstance(given, str) else given
    except InputError as error:
        return Reading(failed=str(error))
    place = None if reaches is not None or observable.times is not None else checkpoints
    runs = [_run(setting, observable, reaches, threads, progress, place, every)]
    while not runs[-1].failed and runs[0].seconds <= SHORT and len(runs) < repeats and _apart(runs) >= SETTLED:
        runs.append(_run(setting, observable, reaches, threads, progress, None, every))
    best = min(runs, key=lambda reading: reading.seconds)
    apart = _apart(runs)
    why = f"its two fastest of {len(runs)} runs differ by {100 * apart:.0f} %" if SETTLED <= apart < math.inf else ""
    return dataclasses.replace(best, unsettled=why)


def _apart(runs: list[Reading]) -> float:
    """Relative difference of the two least seconds; infinite for one run."""
    least = sorted(run.seconds for run in runs)[:2]
    return math.inf if len(least) < 2 else least[1] / least[0] - 1 if least[0] else 0.0


def _run(
    setting: Setting, observable: Observable, reaches: float | None, threads: int | None, progress: Watch | None,
    checkpoints: Path | None, every: float,
) -> Reading:  # fmt: skip
    simulation, clock, value = None, None, math.nan
    try:
        with suppress(InputError):  # there is no whole checkpoint: the run begins anew, with the same result
            if checkpoints is not None and checkpoints.is_dir():
                simulation = Simulation.resume(checkpoints, setting.backend, threads, setting.scene)
        simulation = simulation or Simulation(make_plan(setting.scene), setting.backend, threads)
        clock = _Clock(simulation, progress, checkpoints, every)
        if reaches is None:
            value = _at_end(simulation, observable, clock)
        else:
            value = _when(simulation, observable, reaches, clock)
        failed = "" if math.isfinite(value) else f"observable {observable.name}: its value is not a finite number."
    except (InputError, RunStopped) as error:
        if getattr(error, "reason", "") in NOT_OF_THE_RUN:
            raise
        failed = str(error)
        if simulation is None or clock is None:
            return Reading(failed=failed)
    search, needed = simulation.search, bytes_of(simulation.plan, simulation.backend.name)["total"]
    return Reading(
        value, clock.seconds, clock.wall, needed, simulation.count, simulation.steps,
        simulation.time, search.log.rebuilds if search else 0, failed, float(simulation.plan.state.mass.sum()),
    )  # fmt: skip


class _Clock:
    """Counts the time of the steps alone, without what their first calls took, which may compile: `wall` by the clock,
    `seconds` of the processor, on a GPU of the clock. Writes checkpoints, where there is a folder for them.
    """

    def __init__(self, simulation: Simulation, progress: Watch | None, checkpoints: Path | None, every: float) -> None:
        self.simulation, self.progress, self.checkpoints, self.every = simulation, progress, checkpoints, every
        self.seconds = self.wall = 0.0
        self.gpu = simulation.backend.name == "cuda"
        self.kept_at = time.perf_counter()
        if checkpoints is not None and simulation.steps:
            with suppress(OSError, ValueError):
                self.seconds, self.wall = map(float, json.loads((checkpoints / CLOCK).read_text(encoding="utf-8")))

    def step(self) -> None:
        """One step of the simulation. Raises RunStopped where that is impossible."""
        s = self.simulation
        before, wall, used = sum(s.timings.first_calls.values()), time.perf_counter(), time.process_time()
        try:
            s.step()
        finally:
            took, compiled = time.perf_counter() - wall, sum(s.timings.first_calls.values()) - before
            share = max(1 - compiled / took, 0.0) if took else 0.0
            self.wall += share * took
            self.seconds += share * (took if self.gpu else time.process_time() - used)
        if self.progress is not None:
            self.progress(s)
        overdue = time.perf_counter() - self.kept_at >= self.every
        if self.checkpoints is not None and overdue and s.time < s.plan.scene.end_time:
            self.keep(self.checkpoints)

    def keep(self, folder: Path) -> None:
        """Write a checkpoint. Raises RunStopped("write_failed") or RunStopped("disk_full") where that is impossible."""
        checkpoint = folder / CHECKPOINT
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self.simulation.checkpoint(checkpoint)
            replace_file(folder / CLOCK, json.dumps([self.seconds, self.wall]).encode())
        except (OSError, InputError) as error:
            why = getattr(error, "strerror", None) or error
            raise RunStopped("write_failed", f"{checkpoint} cannot be written ({why}).") from error
        self.kept_at = time.perf_counter()


def _at_end(simulation: Simulation, observable: Observable, clock: _Clock) -> float:
    """The observable from its moments; without these at the scene's end, between the steps before and after it."""
    end, before, watch = simulation.plan.scene.end_time, None, Watching(observable, simulation.plan.scene)
    watch(simulation)
    while watch.due or simulation.time < end:
        near = simulation.last is None or simulation.time + 2 * simulation.last.length >= end
        if observable.times is None and near and simulation.steps:
            before = simulation.time, observable(simulation)
        clock.step()
        watch(simulation)
    if observable.times is not None and observable.seconds is not None:
        clock.seconds = clock.wall = observable.seconds(watch.values)
    after = simulation.time, watch.value(simulation)
    if before is None or after[0] == before[0]:
        return after[1]
    return before[1] + (end - before[0]) / (after[0] - before[0]) * (after[1] - before[1])


def _when(simulation: Simulation, observable: Observable, reaches: float, clock: _Clock) -> float:
    end = simulation.plan.scene.end_time
    seen = [(simulation.time, observable(simulation))]
    rising = seen[0][1] < reaches
    if seen[0][1] == reaches:
        return 0.0
    while simulation.time < end:
        clock.step()
        if simulation.time - seen[-1][0] < end / SAMPLES and simulation.time < end:
            continue
        seen.append((simulation.time, observable(simulation)))
        if (seen[-1][1] >= reaches) if rising else (seen[-1][1] <= reaches):
            (t0, q0), (t1, q1) = seen[-2:]
            return t0 + (reaches - q0) / (q1 - q0) * (t1 - t0)
    nearest = (max if rising else min)(value for _, value in seen)
    raise InputError(
        f"observable {observable.name}: it did not reach {reaches:g} by the end of {end:g} s, only {nearest:.4g};"
        " choose another value or a later end_time."
    )


# Kept results


@functools.cache
def source_digest(root: Path = Path(refsim.core.__file__).parent.parent) -> str:
    """Digest of every source below `root`, refsim, that shapes a run's numbers."""
    digest = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        name = path.relative_to(root)
        if name.parts[0] not in NOT_READ or name.as_posix() in BUT_READ:
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


@functools.cache
def machine() -> str:
    """The machine in words that tell it from another one."""
    return f"{platform.node()}, {platform.machine()}"


def key_of(
    setting: Setting, observable: Observable, reaches: float | None, threads: int | None, where: str | None = None
) -> str:
    """Digest of everything that a run's numbers follow from: scene, its files, observable, backend, versions, sources.

    where  on what its seconds depend; this machine by default
    """
    digest = scene_digest(setting.scene)
    inputs = (setting.backend, observable.digest, reaches, threads, source_digest(), versions())
    digest.update(repr((*inputs, machine() if where is None else where)).encode())
    return digest.hexdigest()[:20]


def scene_digest(scene: Scene) -> Any:
    """A hash that has taken in a scene without its title, which changes no number, and the files that it names."""
    digest = hashlib.sha256(scene_to_toml(msgspec.structs.replace(scene, name="")).encode())
    for part in (*scene.fluid, *scene.solid, *scene.effects):
        if named := getattr(part, "file", ""):
            try:
                with open_regular(named) as opened:
                    digest.update(hashlib.file_digest(opened, "sha256").digest())
            except OSError:  # its run reports it
                digest.update(b"\0" * 32)
    return digest


def kept(folder: Path | None, key: str, notes: list[str] | None = None) -> Reading | None:
    """The reading of an earlier study in this folder; None if there is none, or its file is damaged.

    notes  is given a sentence about a damaged file
    """
    if folder is None or (stored := read_stored(path := folder / f"{key}.json", notes)) is None:
        return None
    try:
        values = {name: math.nan if value == "nan" else value for name, value in stored["reading"].items()}
        reading = msgspec.convert(values, Reading)
        if not reading.failed and not math.isfinite(reading.value):
            raise ValueError("no finite value")
    except (KeyError, AttributeError, ValueError):
        set_aside(path, "holds no reading of a run", notes)
        return None
    return reading


def keep(folder: Path | None, key: str, setting: Setting, reading: Reading) -> None:
    """Store a reading. Raises InputError where the folder cannot be written."""
    if folder is None:
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_stored(
            folder / f"{key}.json",
            {"label": setting.label, "machine": machine(), "reading": plain(dataclasses.asdict(reading))},
        )
    except OSError as error:
        raise InputError(f"study: {folder} cannot be written ({error.strerror or error}); give another.") from error


def kept_or_made(
    folder: Path | None, key: str, setting: Setting, make: Callable[[], Reading], read: Callable[[], str], before: str
) -> Reading:
    """The reading on file, or the one that `make` gives, which is kept; one process after the other computes a run.

    Raises InputError where `read`, a digest of the files that the run reads, is not what it was `before`.
    """
    with nullcontext() if folder is None else in_turn(folder / f"{key}.json.lock"):
        if (stored := kept(folder, key)) is not None:
            return stored
        reading = make()
        if read() != before:
            raise InputError(f"{setting.label}: a file that it reads has changed since the call; call it again.")
        keep(folder, key, setting, reading)
        return reading
