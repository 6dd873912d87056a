"""Tasks in processes of this machine: values, errors, killed processes, memory, devices."""

import pytest

from refsim.cluster import perform, pool
from refsim.cluster.tasks import ATTEMPTS, Task
from refsim.core.errors import InputError, RunStopped
from tests.cluster import cluster_tasks as there
from tests.running import python


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
