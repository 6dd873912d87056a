"""Tasks in processes of this machine, and on a Dask scheduler with three worker processes."""

import os
import subprocess
import sys
from concurrent.futures import CancelledError
from pathlib import Path
from types import SimpleNamespace

import pytest

import refsim
from refsim.cluster import perform, pool, scheduler
from refsim.cluster.tasks import ATTEMPTS, Task
from refsim.core.errors import InputError, RunStopped
from refsim.sweep import sweep
from tests.cluster import cluster_tasks as there
from tests.running import answer_of, awaited, python
from tests.sweep.small_sweep import files, killed_task, same_bits

WORKERS = 3


def test_without_dask_a_sentence_says_what_to_do(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"--scheduler.* needs the package distributed.*extra 'cluster'"):
        list(perform([Task("a", "a", there.square, (1,))], scheduler="tcp://127.0.0.1:1"))


def asked(tasks, **about):
    given = {"nthreads": 1, "resources": {}, "memory_limit": 1000} | about
    return scheduler.resources(tasks, {"tcp://w": given}, "tcp://s")


def test_a_task_asks_for_its_memory_and_its_gpu():
    small, gpu = Task("a", "a", there.square, bytes=10), Task("b", "b", there.square, bytes=10, gpu=True)
    assert asked([small]) == [{}]
    assert asked([small, gpu], resources={"MEMORY": 50, "GPU": 1}) == [{"MEMORY": 10.0}, {"GPU": 1.0}]
    with pytest.raises(InputError, match=r"no worker of tcp://s declares a GPU.*--resources GPU=1"):
        asked([gpu])
    with pytest.raises(InputError, match=r"a: it needs about 10 B of memory and the smallest of the workers has 5 B"):
        asked([small], memory_limit=5)
    with pytest.raises(InputError, match=r"the largest of the workers has 5 B"):
        asked([small], resources={"MEMORY": 5})
    with pytest.raises(InputError, match=r"worker tcp://w does 4 tasks at once in one process"):
        asked([small], nthreads=4)


class Cluster:
    """A scheduler and its workers, in processes."""

    def __init__(self, folder, workers=WORKERS):
        self.file, self.processes = folder / "scheduler.json", []
        paths = [str(Path(refsim.__file__).parent.parent), os.environ.get("PYTHONPATH", "")]
        self.environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_NUM_THREADS": "1"}
        self.log = (folder / "log").open("w")
        self.scheduler = self.start("dask_scheduler", "--port", "0", "--host", "127.0.0.1", "--no-show")
        for k in range(workers):
            self.worker(k)
        import json

        self.address = json.loads(self.file.read_text())["address"]

    def start(self, program, *options):
        words = ["-m", f"distributed.cli.{program}", "--scheduler-file", str(self.file), "--no-dashboard", *options]
        process = subprocess.Popen([sys.executable, *words], env=self.environment, stdout=self.log, stderr=self.log)
        self.processes.append(process)
        awaited(self.file.exists, process)
        return process

    def worker(self, k):
        options = ("--no-nanny", "--nthreads", "1", "--name", f"worker {k}")
        return self.start("dask_worker", *options, "--local-directory", str(self.file.parent))

    def end(self):
        for process in self.processes:
            process.kill()
            process.wait()
        self.log.close()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    return files(tmp_path, monkeypatch)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    pytest.importorskip("distributed", reason="Dask distributed is not installed (refsim[cluster])")
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.end()


@pytest.mark.filterwarnings("default")  # of Dask itself
def test_values_errors_and_a_killed_worker(cluster, tmp_path):
    tasks = [Task(str(k), f"task {k}", there.square, (k,)) for k in range(6)]
    tasks += [Task("wild", "wild", there.diverge), Task("killed", "killed", there.die_once, (str(tmp_path / "m"), 7))]
    watched = []
    found = outcomes(tasks, scheduler=cluster.address, watch=lambda shares, workers: watched.append(workers))
    assert [found[str(k)].value for k in range(6)] == [k * k for k in range(6)]
    assert found["wild"].error.reason == "diverged"
    assert found["killed"].value == (7, "1"), "by another worker"
    assert watched[-1] == WORKERS - 1
    assert found["killed"].worker.startswith("worker ")


@pytest.mark.filterwarnings("default")
def test_a_run_whose_worker_is_killed_goes_on_elsewhere_with_the_same_bits(cluster, folder):
    (outcome,) = perform([killed_task(folder)], scheduler=cluster.address)
    same_bits(folder, outcome)


@pytest.mark.filterwarnings("default")
def test_a_sweep_and_a_study_by_the_workers(cluster, folder, capsys):
    here = sweep("grid.toml", folder="here", jobs=1)
    said = answer_of(capsys, ["sweep", "grid.toml", "--output", "there", "--scheduler", cluster.address])
    assert "4 runs, 4 of them computed now" in said.out
    again = sweep("grid.toml", folder="there", scheduler=cluster.address)
    assert (again.computed, [r.value for r in again.readings]) == (0, [r.value for r in here.readings])


@pytest.mark.filterwarnings("default")
def test_a_scheduler_that_goes_away_ends_with_a_sentence(cluster, monkeypatch):
    found = perform([Task(f"w{k}", "wait", there.wait, (k,)) for k in (0, 600)], scheduler=cluster.address)
    assert next(found).value == 0
    cluster.scheduler.kill()
    with pytest.raises(
        RunStopped, match=r"has gone away; start one again.*goes on from the results of the fin"
    ) as told:
        next(found)
    assert told.value.reason == "scheduler_lost"
    monkeypatch.setattr(scheduler, "PATIENCE", 1.0)
    with pytest.raises(InputError, match="no scheduler answers at"):
        outcomes([Task("a", "a", there.square, (1,))], scheduler=cluster.address)


def test_what_is_lost_between_a_task_and_its_result_is_redone_or_told(monkeypatch):
    """A value is lost with its worker; whatever a client raises whose scheduler is gone is one reason."""
    killed = type("KilledWorker", (Exception,), {"allowed_failures": 2})
    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace(KilledWorker=killed))
    task = Task("a", "a", there.square)
    dead = SimpleNamespace(status="error", exception=lambda timeout: killed())
    assert "a: 3 processes in turn were killed" in str(scheduler._outcome(task, dead).error)

    def ended(status, error):
        return SimpleNamespace(status=status, result=lambda timeout: (_ for _ in ()).throw(error))

    assert scheduler._outcome(task, ended("finished", TimeoutError())) is None
    with pytest.raises(AttributeError):
        scheduler._outcome(task, ended("finished", AttributeError()))
    for status, error, told in (
        ("running", CancelledError(), RunStopped), ("running", OSError(), RunStopped), ("closed", AttributeError(),
        RunStopped), ("running", AttributeError(), AttributeError), ("closed", InputError("x"), InputError),
    ):  # fmt: skip
        with pytest.raises(told), scheduler._answers(SimpleNamespace(status=status), "tcp://s"):
            raise error


def outcomes(tasks, **more):
    return {each.task.key: each for each in perform(tasks, **({"jobs": 2} | more))}


def test_values_and_errors_come_back():
    watched = []
    tasks = [Task(str(k), f"task {k}", there.square, (k,), weight=k) for k in range(3)]
    tasks.append(Task("wild", "wild", there.diverge))
    found = outcomes(tasks, watch=lambda shares, workers: watched.append(workers))
    assert [found[str(k)].value for k in range(3)] == [0, 1, 4]
    assert isinstance(found["wild"].error, RunStopped)
    assert (found["wild"].error.reason, max(watched)) == ("diverged", 2)
    assert all(each.seconds > 0 for each in found.values())
    with pytest.raises(InputError, match="--jobs = 0"):
        outcomes([Task("a", "a", there.square, (1,))], jobs=0)
    assert outcomes([]) == {}


def test_a_killed_process_costs_its_own_task_one_attempt(tmp_path):
    tasks = [
        Task("killed", "killed", there.die_once, (tmp_path / "marker", 7)), Task("other", "other", there.square, (3,)),
    ]  # fmt: skip
    found = outcomes(tasks)
    assert found["killed"].value == (7, "1"), "in another process, of one thread"
    assert found["other"].value == 9


def test_a_task_that_kills_every_process_ends(monkeypatch):
    monkeypatch.setattr(pool, "ATTEMPTS", 2)
    found = outcomes([Task("deadly", "deadly run", there.die), Task("other", "other", there.square, (3,))])
    assert "deadly run: 2 processes in turn were killed" in str(found["deadly"].error)
    assert found["other"].value == 9
    assert ATTEMPTS > 2


def test_memory_is_never_more_than_there_is(monkeypatch):
    monkeypatch.setattr(pool, "host_memory", lambda: {"total": 100, "free": 100})
    most = []
    tasks = [Task(str(k), str(k), there.square, (k,), bytes=60) for k in range(3)]
    tasks.append(Task("large", "large run", there.square, (3,), bytes=101))
    found = outcomes(tasks, watch=lambda shares, workers: most.append(workers))
    assert (max(most), [found[str(k)].value for k in range(3)]) == (1, [0, 1, 4])
    assert "large run: it needs about 101 B of memory and 100 B are available" in str(found["large"].error)


def test_each_process_has_a_gpu_of_its_own(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3,5")
    tasks = [Task(str(k), str(k), there.device, gpu=True) for k in range(2)]
    assert {each.value for each in outcomes(tasks, jobs=4).values()} == {"3", "5"}
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    with pytest.raises(InputError, match="no GPU is visible here"):
        outcomes(tasks)


MAIN_WITH_NUMBA = """
import numba
from refsim.cluster import perform
from refsim.cluster.tasks import Task
from tests.cluster.cluster_tasks import numba_threads
if __name__ == "__main__":
    for each in perform([Task("a", "a", numba_threads)], jobs=1):
        print("threads", each.value, each.error)
"""


def test_a_process_has_one_thread_where_the_main_module_has_loaded_numba(tmp_path):
    script = tmp_path / "main.py"
    script.write_text(MAIN_WITH_NUMBA)
    assert python(script, NUMBA_NUM_THREADS="2").stdout.strip() == "threads 1 None"
