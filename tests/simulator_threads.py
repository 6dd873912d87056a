"""Numba's CUDA simulator with the threads of a block in turn: each runs until it ends or waits for the others.

Numba's own starts a thread of Python for each of a block, and all run at once. Starting them and asking all of them
whether they wait takes longer than most kernels take, and two that request a shared array may get one each.

A device function runs with a stand-in for the module `cuda` among the globals of its module. The simulator puts it
there for each call and removes it at the call's end, also while another thread is still inside. Here the last call
removes it.
"""

import contextlib
import functools
import sys
import threading

import greenlet
import numpy as np


def install():
    """Replace the simulator's exchange of the module, its shared arrays and its loop over the threads of a block."""
    from numba.cuda.simulator import kernel, kernelapi

    kernel.swapped_cuda_module = exchanged
    kernelapi.threading = Threads()
    make = kernelapi.FakeCUDALocal().array

    def shared(arrays, shape, dtype):
        caller = sys._getframe(1)
        place = caller.f_code, caller.f_lineno
        if place not in arrays._allocations:
            arrays._allocations[place] = make(shape, dtype)
        return arrays._allocations[place]

    def run(manager, block, *arguments):
        size, block, votes = (*manager._block_dim, 1, 1)[:3], kernelapi.Dim3(*block), {}
        call = functools.partial(manager._f, *arguments)
        turns = [Turn(call, block, kernelapi.Dim3(*place), size, votes) for place in np.ndindex(*size)]
        while turns:
            for turn in turns:
                turn.switch()
            turns = [turn for turn in turns if not turn.dead]

    kernelapi.FakeCUDAShared.array = shared
    kernel.BlockManager.run = run


class Threads:
    """The module `threading` with the simulated thread as the current one, while there is one."""

    def current_thread(self):
        current = greenlet.getcurrent()
        return current if isinstance(current, Turn) else threading.current_thread()

    def __getattr__(self, name):
        return getattr(threading, name)


class Turn(greenlet.greenlet):
    """A simulated thread that runs until it waits or ends, while the others of its block do not.

    votes  values given by the threads of the block, by the number of their wait
    """

    def __init__(self, call, block, place, size, votes):
        super().__init__(call)
        self.blockIdx, self.threadIdx, self.votes, self.waits = block, place, votes, 0
        self.thread_id = place.x + size[0] * (place.y + size[1] * place.z)

    def syncthreads(self):
        """Let the others of the block come as far."""
        self.waits += 1
        self.parent.switch()

    def _after_all(self, value):
        given = self.votes.setdefault(self.waits, [])
        given.append(value)
        self.syncthreads()
        return given

    def syncthreads_count(self, value):
        """How many of the block's values are true."""
        return int(np.count_nonzero(self._after_all(value)))

    def syncthreads_and(self, value):
        """Whether all of the block's values are true."""
        return int(all(self._after_all(value)))

    def syncthreads_or(self, value):
        """Whether one of the block's values is true."""
        return int(any(self._after_all(value)))


LOCK = threading.Lock()
INSIDE = {}  # by the identity of a module's globals: calls inside, and what stood there


@contextlib.contextmanager
def exchanged(function, stand_in):
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
