"""Kernels compiled before they are needed, in processes side by side.

They compile what the cache lacks, one kernel after another, and store it; the run then loads it. If the cache folder
cannot be written, nothing is compiled ahead. For the CPU only.
"""

import contextlib
import queue
import threading
from collections.abc import Callable, Iterable
from typing import Any

import numba
import numpy as np

from refsim.backends.cache import recorded
from refsim.backends.cache_files import is_stored
from refsim.backends.compile import Kernel
from refsim.backends.plain import PlainKernel
from refsim.backends.scratch import Scratch
from refsim.backends.threads import cores
from refsim.backends.workers import Task, Worker

FIRST_ROWS = 64
Call = tuple[Any, tuple[Any, ...]]  # a kernel and arguments of the types for which it is needed


def launched_by(function: Callable, arguments: Iterable[Any]) -> list[Call]:
    """The kernels that a program launches, with arguments of their types; none of them runs.

    That is the program itself, or it is a host function that launches kernels. Such a function gets the first rows of
    copies of its arrays, and scratch memory of zeros. Where it takes an object of the run, which it could change, the
    list is empty; where it fails on such arguments, the list ends there.
    """
    if isinstance(function, Kernel) or hasattr(function, "store"):
        return [(function, tuple(arguments))]
    try:
        small = [_small(value) for value in arguments]
    except TypeError:
        return []
    with recorded() as calls, contextlib.suppress(Exception):
        function(*small)
    return calls


class _Zeros(Scratch):
    """Scratch memory of zeros, with which a host function's loops end."""

    def array(self, name: str, shape: Any, dtype: Any) -> Any:
        array = super().array(name, shape, dtype)
        array[...] = 0
        return array


def _small(value: Any) -> Any:
    """The value, with the first rows of copies of its arrays. Raises TypeError for an object."""
    if isinstance(value, np.ndarray):
        return value[:FIRST_ROWS].copy()
    if isinstance(value, tuple):
        return type(value)._make(map(_small, value)) if hasattr(value, "_make") else tuple(map(_small, value))
    if isinstance(value, Scratch):
        return _Zeros(value.backend)
    if value is None or isinstance(value, (str, bool, int, float, np.generic)):
        return value
    raise TypeError


def missing(calls: Iterable[Call]) -> list[Task]:
    """The kernels of the calls whose code the cache does not hold, each once for the same types."""
    found: dict[tuple[int, Any], Task | None] = {}
    for kernel, values in calls:
        program = kernel.on("cpu") if isinstance(kernel, Kernel) else kernel
        if isinstance(program, PlainKernel):
            program, values = program.program(values)
        if not hasattr(program, "store"):  # plain Python, or nothing is stored
            continue
        try:
            types = tuple(numba.typeof(value) for value in values)
        except ValueError:  # an object that no kernel takes
            continue
        if (id(program), types) in found or types in program.overloads or is_stored(program, types):
            continue
        found[id(program), types] = Task.of(program, types)
    return [task for task in found.values() if task is not None]


def compile_ahead(calls: Iterable[Call], begun: Callable[[int, int], Callable[[], Any]]) -> None:
    """Store what the cache lacks of the calls, in processes side by side; return when they have ended.

    There are as many processes as cores, and two kernels at least for each, which needs a second to start; for fewer
    than two processes nothing is done.

    begun  is told (number of kernels, number of processes), and gives what is called after each kernel
    """
    wanted = missing(calls)
    count = min(cores(), len(wanted) // 2)
    if count < 2:
        return
    tasks: queue.SimpleQueue[Task] = queue.SimpleQueue()
    for task in wanted:
        tasks.put(task)
    stored: queue.SimpleQueue[bool] = queue.SimpleQueue()  # a kernel, or (False) the end of a process
    workers: list[Worker] = []

    def employ(worker: Worker) -> None:
        try:
            while worker.store(tasks.get_nowait()):  # whatever the answer
                stored.put(True)
        except queue.Empty:
            pass
        finally:
            stored.put(False)

    try:
        for _ in range(count):
            workers.append(Worker())
            threading.Thread(target=employ, args=(workers[-1],), daemon=True).start()
        after_each = begun(len(wanted), count)
        running = count
        while running:
            if stored.get():
                after_each()
            else:
                running -= 1
    except OSError:  # no process can be started: the run compiles what it comes to, and says so
        pass
    finally:
        for worker in workers:
            worker.close()
