"""Numba's CUDA simulator with its threads in turn where they never wait for each other, and sound where they do.

Every thread of a block is one of Python's, which takes longer to start than most kernels take. Where neither a kernel
nor what it calls synchronises, its threads run one after another without one.

A device function runs with a stand-in for the module `cuda` among the globals of its module. The simulator puts it
there for each call and removes it at the call's end, also while another thread is still inside. Here the last call
removes it.
"""

import contextlib
import contextvars
import functools
import threading
import types
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np


def install() -> None:
    """Replace the simulator's exchange of the module and its loop over the threads of a block."""
    from numba.cuda.simulator import kernel, kernelapi

    kernel.swapped_cuda_module = exchanged
    kernelapi.threading = Threads()
    together = kernel.BlockManager.run

    def run(manager: Any, block: Any, *arguments: Any) -> None:
        if waits(manager._f):
            together(manager, block, *arguments)
        else:  # in a context of its own, as a thread has one
            contextvars.Context().run(in_turn, manager, kernelapi.Dim3(*block), arguments)

    kernel.BlockManager.run = run


class Threads:
    """The module `threading` with the simulated thread as the current one, while there is one."""

    current: Any = None

    def current_thread(self) -> Any:
        return Threads.current or threading.current_thread()

    def __getattr__(self, name: str) -> Any:
        return getattr(threading, name)


class Turn:
    """A simulated thread that runs while the others of its block do not."""

    def __init__(self, block: Any, place: Any, size: Sequence[int]) -> None:
        self.blockIdx, self.threadIdx = block, place
        self.thread_id = place.x + size[0] * (place.y + size[1] * place.z)


def in_turn(manager: Any, block: Any, arguments: Sequence[Any]) -> None:
    """Run the threads of a block one after another."""
    size = (*manager._block_dim, 1, 1)[:3]
    try:
        for place in np.ndindex(*size):
            Threads.current = Turn(block, type(block)(*place), size)
            manager._f(*arguments)
    finally:
        Threads.current = None


@functools.cache
def waits(function: Any) -> bool:
    """Whether the function, or one that it names, synchronises threads, shares memory or passes values among them."""
    seen: set[Any] = set()
    waiting = [function]
    while waiting:
        found = waiting.pop()
        found = getattr(found, "fn", found)  # of a simulated kernel or device function
        if not isinstance(found, types.FunctionType) or found in seen:
            continue
        seen.add(found)
        names = named(found.__code__)
        if any(name.startswith(("sync", "shfl", "shared", "cg")) for name in names):
            return True
        held = [cell.cell_contents for cell in found.__closure__ or ()]
        held += [found.__globals__[name] for name in names if name in found.__globals__]
        modules = [value for value in held if isinstance(value, types.ModuleType)]
        waiting += [*held, *(getattr(module, name, None) for module in modules for name in names)]
    return False


def named(code: types.CodeType) -> set[str]:
    """Names of globals and attributes in a function's code, and in that of the functions inside."""
    inside = [part for part in code.co_consts if isinstance(part, types.CodeType)]
    return set(code.co_names).union(*map(named, inside))


LOCK = threading.Lock()
INSIDE: dict[int, tuple[int, dict]] = {}  # by the identity of a module's globals: calls inside, and what stood there


@contextlib.contextmanager
def exchanged(function: Any, stand_in: Any) -> Iterator[None]:
    """The stand-in among the function's globals until the last call has left."""
    from numba import cuda

    names = function.__globals__
    with LOCK:
        count, before = INSIDE.get(id(names), (0, {}))
        if not count:
            before = {name: value for name, value in names.items() if value is cuda}
            names.update(dict.fromkeys(before, stand_in))
        INSIDE[id(names)] = count + 1, before
    try:
        yield
    finally:
        with LOCK:
            count, before = INSIDE.pop(id(names))
            if count > 1:
                INSIDE[id(names)] = count - 1, before
            else:
                names.update(before)
