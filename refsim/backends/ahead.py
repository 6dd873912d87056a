"""Kernels compiled before they are needed, in processes side by side.

Child processes compile what the cache lacks, one kernel after another, and store it; the run then loads it. Without a
cache folder that can be written to, or without `fork`, nothing is compiled ahead. For the CPU only: a process that uses
a GPU must not be forked.
"""

from __future__ import annotations

import contextlib
import gc
import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numba
import numpy as np

from refsim.backends.cache_files import is_stored
from refsim.backends.compile import Kernel

LONGEST = 300  # seconds after which a child gives up; the run then compiles itself
Call = tuple[Any, tuple[Any, ...]]  # a kernel and arguments of the types for which it is needed


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def missing(calls: Iterable[Call]) -> list[tuple[Any, tuple[Any, ...]]]:
    """(kernel, types) of the calls whose code the cache does not hold, each once."""
    found: dict[tuple[int, Any], tuple[Any, tuple[Any, ...]]] = {}
    for kernel, values in calls:
        program = kernel.on("cpu") if isinstance(kernel, Kernel) else kernel
        if not hasattr(program, "store"):  # plain Python, or nothing is stored
            continue
        try:
            types = tuple(numba.typeof(value) for value in values)
        except ValueError:  # an object that no kernel takes
            continue
        if types not in program.overloads and not is_stored(program, types):
            found[id(program), types] = (program, types)
    return list(found.values())


def compile_ahead(calls: Iterable[Call], begun: Callable[[int, int], Callable[[], Any]]) -> None:
    """Store what the cache lacks of the calls, in as many processes as there are cores; return when they have ended.

    begun  is told (number of kernels, number of processes), and gives what is called after each kernel
    """
    wanted = missing(calls) if hasattr(os, "fork") else []
    workers = min(cores(), len(wanted))
    if workers < 2:
        return
    after_each = begun(len(wanted), workers)
    tasks, put = os.pipe()
    finished, finish = os.pipe()
    os.write(put, np.arange(len(wanted), dtype=np.uint16).tobytes())
    os.close(put)
    children = []
    for _ in range(workers):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of forking beside threads: the child uses none of them
            child = os.fork()
        if child == 0:
            _work(wanted, tasks, finish)
        children.append(child)
    os.close(tasks)
    os.close(finish)
    try:
        while os.read(finished, 1):  # until the last child has closed it
            after_each()
    finally:
        os.close(finished)
        for child in children:
            with contextlib.suppress(ChildProcessError):
                os.waitpid(child, 0)


def _work(wanted: list[tuple[Any, Any]], tasks: int, finish: int) -> None:
    """Compile one kernel after another until none is left; ends the process."""
    try:
        warnings.simplefilter("ignore")  # the parent says what the cache refuses
        gc.disable()
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(LONGEST)
        while number := os.read(tasks, 2):
            program, types = wanted[int.from_bytes(number, sys.byteorder)]
            with contextlib.suppress(Exception):  # it is found again, and raised, where the kernel is run
                program.store(types)
            os.write(finish, b"1")
    finally:
        os._exit(0)
