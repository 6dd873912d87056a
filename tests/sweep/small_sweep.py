"""A small sweep, and a run of it whose process is killed."""

import dataclasses

from refsim.scene.plan import make_plan
from refsim.study import runs, tasks
from refsim.study.observables import observable_of
from refsim.sweep import points_of, read_sweep
from tests.cluster import cluster_tasks as there
from tests.running import rows
from tests.tank_file import GRAVITY, tank

SCENE = tank(0.002, more=GRAVITY)
SWEEP = rows(__file__, "sweep")


def files(folder, monkeypatch):
    """The folder, now the current one, with scene and sweep."""
    monkeypatch.chdir(folder)
    (folder / "tank.toml").write_text(SCENE)
    (folder / "grid.toml").write_text(SWEEP)
    return folder


def points(folder, text):
    (folder / "other.toml").write_text(text)
    return points_of(read_sweep(folder / "other.toml"), folder, "other.toml")


def setting(folder, place):
    point = points(folder, SWEEP)[place]
    return runs.Setting("sweep", point.label, 1.0, point.scene, "numpy")


def observable(folder):
    return observable_of("kinetic_energy", make_plan(setting(folder, 0).scene))


def killed_task(folder):
    """A task that writes a checkpoint at every step and whose first process is killed beyond half of the run."""
    task = tasks.task_of("key", setting(folder, 1), "kinetic_energy", folder / "store", 1e-9)
    work = (*task.arguments, str(folder / "marker"), str(folder / "shares"))
    return dataclasses.replace(task, function=there.killed_run, arguments=work)


def same_bits(folder, outcome):
    """The killed run has gone on from its checkpoint, and gave what it gives undisturbed."""
    whole = runs.measure(setting(folder, 1), observable(folder), threads=1)
    assert outcome.error is None
    assert (outcome.value.value, outcome.value.steps) == (whole.value, whole.steps)
    told = [line.split() for line in (folder / "shares").read_text().splitlines()]
    processes = list(dict.fromkeys(process for process, _ in told))
    assert len(processes) == 2
    first, second = ([float(share) for process, share in told if process == p] for p in processes)
    assert second[0] >= first[-2], "at most the last checkpoint interval is lost"
    assert runs.kept(folder / "store", "key") == outcome.value
    assert not list((folder / "store" / tasks.RUNNING).iterdir())
