"""Tasks on the workers of a Dask scheduler (extra `[cluster]`).

A worker does one task at a time (`--nthreads 1`). A task that needs a GPU requires the resource GPU of its worker.
Where workers declare the resource MEMORY [bytes], every task requires its share of it. The scheduler gives the task of
a worker that is lost to another one.
"""

import itertools
import logging
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, suppress
from typing import Any

from refsim.cluster.tasks import Outcome, Task, Watch, killed
from refsim.core.errors import InputError, RefsimError, RunStopped, extra
from refsim.core.tables import in_bytes

TOPIC = "refsim"  # of the workers' reports
PAUSE = 0.5  # [s] between two looks at the tasks
PATIENCE = 30.0  # [s] in which scheduler and first worker must answer
BETWEEN_REPORTS = 1.0  # [s]
AHEAD = 32  # tasks for each worker that the scheduler knows at one time; it keeps about 10 kB of memory for each
GPU, MEMORY = "GPU", "MEMORY"  # resources that workers declare


def by_scheduler(
    tasks: Sequence[Task], address: str, watch: Watch, say: Callable[[str], None]
) -> Generator[Outcome, None, None]:
    """Outcomes of tasks on the workers of the scheduler at `address`, in the order in which they end."""
    client = connect(address)
    shares: dict[str, float] = {}
    waiting: dict[Any, Task] = {}
    try:
        with _answers(client, address):
            workers = _workers(client, address)
            count = len(workers)
            left = iter(sorted(zip(tasks, resources(tasks, workers, address)), key=lambda pair: -pair[0].weight))
            client.subscribe_topic(TOPIC, lambda event: shares.update([event[1]]))
        while True:
            with _answers(client, address):
                for task, wanted in itertools.islice(left, max(AHEAD * max(count, 1) - len(waiting), 0)):
                    future = client.submit(
                        _there, task.key, task.function, task.arguments,
                        key=f"refsim-{task.key}", pure=False, resources=wanted, priority=task.weight,
                    )  # fmt: skip
                    waiting[future] = task
            if not waiting:
                return
            time.sleep(PAUSE)
            with _answers(client, address):
                before, count = count, len(_known(client))
                if any(future.status == "cancelled" for future in waiting):
                    raise CancelledError
            if before and not count:
                say(f"no worker is left; the runs wait until one is started with `dask worker {address} --nthreads 1`")
            for future in list(waiting):
                if future.status not in ("finished", "error"):
                    continue
                with _answers(client, address):
                    outcome = _outcome(waiting[future], future)
                if outcome is not None:
                    shares.pop(waiting.pop(future).key, None)
                    yield outcome
            under_way = {task.key for task in waiting.values()}
            watch({k: s for k, s in list(shares.items()) if k in under_way}, count)
    finally:
        with suppress(Exception):
            client.close(timeout=2)


@contextmanager
def _answers(client: Any, address: str) -> Iterator[None]:
    """Raises RunStopped("scheduler_lost") for whatever a client raises whose scheduler goes away.

    These are FutureCancelledError, CommClosedError and other errors of the connection; and once the client has noticed
    it, any other: RuntimeError of its closed event loop, AttributeError of what it has set to None.
    """
    try:
        yield
    except RefsimError:
        raise
    except Exception as error:
        if client.status == "running" and not isinstance(error, CancelledError | OSError):
            raise
        raise RunStopped(
            "scheduler_lost",
            f"The scheduler at {address} has gone away; start one again, and the same command with its address goes on"
            " from the results of the finished runs.",
        ) from error


def _outcome(task: Task, future: Any) -> Outcome | None:
    """What became of a task that has ended; None where its value is lost with its worker, and it is redone."""
    from distributed import KilledWorker

    if future.status != "error":
        try:
            value, seconds, worker = future.result(timeout=PATIENCE)
            return Outcome(task, value, None, seconds, worker)
        except TimeoutError:
            return None
        except Exception:
            if future.status != "error":  # unlike that of a task that was redone
                raise
    error = future.exception(timeout=PATIENCE)
    if isinstance(error, KilledWorker):
        error = killed(task, error.allowed_failures + 1)
    return Outcome(task, error=error)


def connect(address: str) -> Any:
    """A client of the scheduler. Raises InputError where Dask distributed is absent or nothing answers."""
    distributed = extra("distributed", "a scheduler (--scheduler)")
    for name in ("distributed", *logging.root.manager.loggerDict):  # errors are told in one sentence
        if name.split(".")[0] in ("distributed", "tornado"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError, ImportError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"no scheduler answers at {address} ({reason}); start one with `dask scheduler` and give the address that"
            " it prints, such as tcp://10.0.0.1:8786."
        ) from None
    client.loop.asyncio_loop.set_exception_handler(lambda loop, context: None)  # it would log them
    return client


def _workers(client: Any, address: str) -> dict[str, Any]:
    """The workers that are there, once there is one."""
    until = time.monotonic() + PATIENCE
    while not (workers := _known(client)):
        if time.monotonic() > until:
            raise InputError(f"the scheduler at {address} has no workers; run `dask worker {address} --nthreads 1`.")
        time.sleep(PAUSE)
    return workers


def _known(client: Any) -> dict[str, Any]:
    """The workers that are there. Raises CancelledError where the connection to the scheduler is lost."""
    if client.status != "running":
        raise CancelledError
    return dict(client.scheduler_info(n_workers=-1)["workers"])


def resources(tasks: Sequence[Task], workers: dict[str, Any], address: str) -> list[dict[str, float]]:
    """What each task requires of its worker. Raises InputError where the workers cannot do the tasks."""
    start = f"dask worker {address} --nthreads 1"
    for name, about in workers.items():
        if about["nthreads"] != 1:
            raise InputError(
                f"worker {name} does {about['nthreads']} tasks at once in one process, which Numba's threads do not"
                f" allow; start it with `{start}`, several times with --nworkers."
            )
    declared = [about.get("resources") or {} for about in workers.values()]
    if any(task.gpu for task in tasks) and not any(has.get(GPU) for has in declared):
        raise InputError(
            f"no worker of {address} declares a GPU; start one for each with"
            f" `CUDA_VISIBLE_DEVICES=0 {start} --resources GPU=1`."
        )
    by_resource = any(MEMORY in has for has in declared)
    if by_resource:
        most = max(has.get(MEMORY, 0.0) for has in declared)
    else:
        most = min(about.get("memory_limit") or float("inf") for about in workers.values())
    asked = []
    for task in tasks:
        if task.bytes > most and not task.gpu:
            which = "the largest of the workers has" if by_resource else "the smallest of the workers has"
            raise InputError(
                f"{task.name}: it needs about {in_bytes(task.bytes)} of memory and {which} {in_bytes(most)}; start"
                f" larger ones that declare theirs [bytes], as in `{start} --resources MEMORY=64e9`."
            )
        memory = {MEMORY: float(task.bytes)} if by_resource and task.bytes and not task.gpu else {}
        asked.append(memory | ({GPU: 1.0} if task.gpu else {}))
    return asked


def _there(key: str, function: Any, arguments: tuple[Any, ...]) -> tuple[Any, float, str]:
    """Do a task on a worker; returns its value, its wall seconds and the worker."""
    from distributed import get_worker

    worker, began = get_worker(), time.perf_counter()
    told = 0.0

    def report(share: float) -> None:
        nonlocal told
        if time.monotonic() - told > BETWEEN_REPORTS:
            told = time.monotonic()
            worker.log_event(TOPIC, (key, min(max(share, 0.0), 1.0)))

    report(0.0)
    return function(report, *arguments), time.perf_counter() - began, str(worker.name)
