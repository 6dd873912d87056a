"""Runs of sweeps as tasks of `refsim.cluster`: what travels to another process, and what that one does."""

import os
import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from refsim.cluster.tasks import Report, Task
from refsim.core.errors import InputError
from refsim.core.versions import versions
from refsim.engine.simulation import Simulation
from refsim.scene.plan import make_plan
from refsim.scene.scene import Scene
from refsim.study import runs
from refsim.study.cost import bytes_of
from refsim.study.observables import digest_of
from refsim.study.runs import Reading, Setting, source_digest

RUNNING = "running"  # folder of the checkpoints of runs under way, below that of the results


@dataclass(frozen=True)
class Work:
    """A run for another process, which may be on another machine with the same folders."""

    key: str
    setting: Setting
    observable: str  # as a text, its file by the whole path
    folder: str  # in which the result is kept, the whole path; below it the run leaves its checkpoints
    made_by: tuple[tuple[str, str], ...]  # digest of the sources and versions that compute the result
    read: str  # digest of the files that it reads, as they were when the key was made
    every: float  # seconds of wall time between two checkpoints


def made_by() -> tuple[tuple[str, str], ...]:
    """Digest of the sources, and the versions that compute."""
    return ("sources", source_digest()), *sorted(versions().items())


def task_of(key: str, setting: Setting, observable: str, folder: Path, every: float = 60.0) -> Task:
    """The task that computes a run; its memory and its weight follow from the plan."""
    whole = whole_name(observable)
    work = Work(key, setting, whole, os.path.realpath(folder), made_by(), _read(setting.scene, whole), every)
    return Task(key, setting.label, compute, (work,), *weighed(setting), setting.backend == "cuda")


def weighed(setting: Setting) -> tuple[float, int]:
    """(work, bytes) of a run; its work is as its particles and as its steps where sound sets them. 0 without a plan."""
    scene = setting.scene
    try:
        plan = make_plan(scene)
    except InputError:  # the run's result says why
        return 0.0, 0
    return plan.grid.count * scene.end_time / scene.spacing, bytes_of(plan, setting.backend)["total"]


def _read(scene: Scene, observable: str) -> str:
    """Digest of the scene's files and of the observable's."""
    return f"{runs.scene_digest(scene).hexdigest()} {digest_of(observable)}"


def whole_name(observable: str) -> str:
    """The observable with the whole path of its file, which another process finds from its own folder."""
    path, _, function = observable.rpartition(":")
    return f"{os.path.abspath(path)}:{function}" if path.endswith(".py") else observable


def compute(report: Report, work: Work) -> Reading:
    """Compute a run, keep its result in the folder of results, and return it; one that is there is not computed again.

    Raises InputError where sources or versions are not those of the task, and RunStopped where the machine, and not the
    run, is the reason.
    """
    here, there = dict(made_by()), dict(work.made_by)
    if other := sorted(name for name in here.keys() | there if here.get(name) != there.get(name)):
        said = ", ".join(f"{name}: {here.get(name, 'none')} for {there.get(name, 'none')}" for name in other)
        raise InputError(
            f"{work.setting.label}: the worker has another refsim, or other packages, than the caller ({said}); install"
            " the same on both."
        )
    folder, scene = Path(work.folder), work.setting.scene
    place = folder / RUNNING / work.key

    def progress(simulation: Simulation) -> None:
        report(simulation.time / scene.end_time if scene.end_time else 1.0)

    made = partial(runs.measure, work.setting, work.observable, None, 1, progress, 1, place, work.every)
    reading = runs.kept_or_made(folder, work.key, work.setting, made, partial(_read, scene, work.observable), work.read)
    shutil.rmtree(place, ignore_errors=True)
    return reading
