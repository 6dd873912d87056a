"""Tasks in processes of this machine.

Each process has an executor of its own, so that a killed one costs its own task alone. A task begins when its memory
fits beside that of the tasks under way; where tasks need a GPU, each process has one of its own. The processes end with
the one that started them, however that ends.
"""

import contextlib
import math
import multiprocessing
import os
import time
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from refsim.backends.arrays import host_memory, unavailable
from refsim.cluster.tasks import ATTEMPTS, ONE_THREAD, Outcome, Task, Watch, killed
from refsim.core.errors import InputError
from refsim.core.stopping import deaf_to_ctrl_c, end_with
from refsim.core.tables import in_bytes

PAUSE = 0.5  # [s] between two calls of `watch`
_shares: Any = None  # in a process: share done of every task, in memory that all processes see


@dataclass
class _Slot:
    """A process, its task and since when it is under way."""

    name: str
    device: str | None
    executor: Any = None
    place: int = 0
    began: float = 0.0


def by_processes(tasks: Sequence[Task], jobs: int, watch: Watch) -> Generator[Outcome, None, None]:
    """Outcomes of tasks in `jobs` processes of one thread each, the heaviest task first."""
    devices: list[str | None] = [None] * jobs
    if any(task.gpu for task in tasks):
        devices = list[str | None](visible_devices())[:jobs]
        if not devices:
            raise InputError("no GPU is visible here; take another backend, or a scheduler whose workers have GPUs.")
    context = multiprocessing.get_context("spawn")  # a forked process would inherit the threads of Numba's pool
    shares = context.Array("d", len(tasks), lock=False)
    parent, alive = context.Pipe(duplex=False)  # the end `alive` is in this process alone
    free_memory = host_memory()["free"]
    memory = math.inf if free_memory is None else float(free_memory)
    waiting = sorted(range(len(tasks)), key=lambda k: -tasks[k].weight)
    free = [_Slot(f"process {k}", device) for k, device in enumerate(devices[: len(tasks)])]
    busy: dict[Future[Any], _Slot] = {}
    attempts = [0] * len(tasks)
    try:
        while waiting or busy:
            for place in list(waiting):
                needed = tasks[place].bytes
                if needed > memory:
                    waiting.remove(place)
                    said = f"{tasks[place].name}: it needs about {in_bytes(needed)} of memory and {in_bytes(memory)}"
                    said += " are available; take fewer particles or a larger machine."
                    yield Outcome(tasks[place], error=InputError(said))
                elif free and needed + sum(tasks[slot.place].bytes for slot in busy.values()) <= memory:
                    waiting.remove(place)
                    slot = free.pop()
                    if slot.executor is None:
                        slot.executor = ProcessPoolExecutor(
                            1, mp_context=context, initializer=_begin, initargs=(shares, parent)
                        )
                    slot.place, slot.began, shares[place] = place, time.perf_counter(), 0.0
                    attempts[place] += 1
                    with _environment_of(slot.device), deaf_to_ctrl_c():  # the first task starts the process
                        busy[slot.executor.submit(_there, place, tasks[place])] = slot
            done, _ = wait(busy, timeout=PAUSE, return_when=FIRST_COMPLETED)
            watch({tasks[s.place].key: shares[s.place] for s in busy.values()}, len(busy))
            for future in done:
                slot = busy.pop(future)
                free.append(slot)
                task, error = tasks[slot.place], future.exception()
                if isinstance(error, BrokenProcessPool):
                    slot.executor.shutdown()
                    slot.executor = None
                    if attempts[slot.place] < ATTEMPTS:
                        waiting.insert(0, slot.place)
                        continue
                    error = killed(task, ATTEMPTS)
                seconds = time.perf_counter() - slot.began
                yield Outcome(task, None if error else future.result(), error, seconds, slot.name)
    except BaseException:  # also where the caller wants no more of them: what is under way ends now
        alive.close()
        raise
    finally:
        for slot in (*free, *busy.values()):
            if slot.executor is not None:
                slot.executor.shutdown(cancel_futures=True)
        alive.close()
        parent.close()


def visible_devices() -> list[str]:
    """Names of the CUDA devices as CUDA_VISIBLE_DEVICES takes them."""
    named = os.environ.get("CUDA_VISIBLE_DEVICES")
    if named is not None:
        return [word.strip() for word in named.split(",") if word.strip()]
    if unavailable("cuda") is not None:
        return []
    from numba import cuda

    return [str(k) for k in range(len(cuda.gpus))]


@contextlib.contextmanager
def _environment_of(device: str | None) -> Iterator[None]:
    """The environment of a process that starts meanwhile: its main module may load Numba before `_begin` is called."""
    before = dict(os.environ)
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    if device is not None:
        os.environ["CUDA_VISIBLE_DEVICES"] = device
    try:
        yield
    finally:
        for name in (*ONE_THREAD, "CUDA_VISIBLE_DEVICES"):
            if name in before:
                os.environ[name] = before[name]
            else:
                os.environ.pop(name, None)


def _begin(shares: Any, parent: Any) -> None:
    """Make a new process ready."""
    global _shares
    _shares = shares
    end_with(parent)


def _there(place: int, task: Task) -> Any:
    """Do a task in a process; its share done stands at `place`."""

    def report(share: float) -> None:
        _shares[place] = min(max(share, 0.0), 1.0)

    return task.function(report, *task.arguments)
