"""Numba's CUDA simulator with device functions that several threads may leave at different times.

A device function runs with a stand-in for the module `cuda` among the globals of its module. The simulator puts it
there for each call and removes it at the call's end, also while another thread is still inside. Here the last call
removes it.
"""

import contextlib
import threading


def install():
    """Replace the simulator's exchange of the module."""
    from numba.cuda.simulator import kernel

    kernel.swapped_cuda_module = exchanged


LOCK = threading.Lock()
INSIDE: dict[int, tuple[int, dict]] = {}  # by the identity of a module's globals: calls inside, and what stood there


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
