"""CPU threads: the layer that starts them, how many a loop gains from, their places. No result depends on these."""

import importlib
import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from refsim.core.errors import InputError

POOLS = {"workqueue": "workqueue", "omp": "omppool", "tbb": "tbbpool", "safe": "tbbpool"}  # modules of layers
ANY = ("default", "forksafe", "threadsafe")  # of which Numba takes what there is
ROWS_OF_A_THREAD = 1024
LOOK = 0.2  # [s] between looks at what other programs take
OTHERS = 0.25  # processors that they may take while each thread stays on its own


def check_number() -> None:
    """Raises InputError for a NUMBA_NUM_THREADS with which Numba cannot be imported."""
    with suppress(ValueError):  # of no number: Numba takes all processors
        if int(os.environ.get("NUMBA_NUM_THREADS", 1)) < 1:
            raise InputError("NUMBA_NUM_THREADS is below 1; give at least 1, or leave the variable out.")


def choose_layer() -> None:
    """Have Numba start its threads by its own work queue, unless NUMBA_THREADING_LAYER names another layer.

    Called before the first loop, after which Numba keeps its layer. OpenMP's threads wait in a busy loop: where cores
    are shared, a barrier then takes milliseconds. Raises InputError for a layer that cannot be had.
    """
    import numba

    name = os.environ.get("NUMBA_THREADING_LAYER")
    if name is None:
        numba.config.THREADING_LAYER = "workqueue"
    elif name in POOLS:
        try:
            importlib.import_module(f"numba.np.ufunc.{POOLS[name]}")
        except ImportError as error:
            raise InputError(
                f"NUMBA_THREADING_LAYER = {name}: its library cannot be loaded ({error}); install it, or leave the"
                " variable out."
            ) from None
    elif name not in ANY:
        raise InputError(
            f"NUMBA_THREADING_LAYER = {name}: there is no such layer; choose one of {', '.join((*POOLS, *ANY))}."
        )


class Places:
    """Numba's threads while loops of this library work: how many, and each on a processor of its own.

    A virtual machine does not show which processors are idle. Linux then wakes a thread on the processor of the one
    that wakes it, and short loops of all threads take turns on one. Beside another program threads are free to move.

    threads  the system's numbers of Numba's threads; none where it does not tell, or where others started them
    """

    def __init__(self) -> None:
        self.threads: list[int] | None = None  # until they are started
        self.pinned_to: list[int] = []  # a processor for each, where each is to have one
        self.free: list[set[int]] = []  # processors of each outside of the blocks
        self.pinned = False
        self.number = 0  # of threads in the block that is under way
        self.last_look = (0.0, 0.0)  # time of the last look [s], and what other programs had taken [s of a processor]

    @contextmanager
    def used(self, number: int) -> Iterator[None]:
        """Have the block's loops use so many of Numba's threads; after it number and processors are as before."""
        if number == self.number:  # within another block
            yield
            return
        import numba

        if self.threads is None:
            others = _tasks()
            numba.get_num_threads()  # starts them
            self.threads = sorted(_tasks() - others)
        before, around, pinned = numba.get_num_threads(), self.number, self.pinned
        self.number = number
        try:
            if number != before:  # a call takes microseconds
                numba.set_num_threads(number)
            self._pin(pinned or number == len(self.pinned_to))
            yield
        finally:
            self.number = around
            self._pin(pinned and bool(self.pinned_to))
            if number != before:
                numba.set_num_threads(before)

    def keep(self) -> None:
        """Pin the threads, or let them move, by what other programs took since the last look."""
        at, (before, taken) = time.perf_counter(), self.last_look
        if not self.threads or at < before + LOOK:
            return
        import numba

        try:
            mask = sorted(os.sched_getaffinity(0))
            self.last_look = at, _busy(mask) - time.process_time()
            alone = not before or self.last_look[1] - taken < OTHERS * (at - before)
            pin = alone and 1 < len(mask) == len(self.threads) == numba.get_num_threads()
        except (AttributeError, OSError, ValueError):  # a system without these
            mask, pin, self.last_look = [], False, (math.inf, 0.0)
        self.pinned_to = mask if pin else []
        self._pin(pin)

    def _pin(self, pin: bool) -> None:
        """Each thread on one of `own`, unless it has been given other processors; or on those that it had before."""
        if pin == self.pinned or not self.threads:
            return
        with suppress(OSError):  # a thread has ended, or its processors are no longer this process's
            if pin:
                self.free = [os.sched_getaffinity(thread) for thread in self.threads]
                if any(each != set(self.pinned_to) for each in self.free):
                    return
            self.pinned = pin
            for thread, processors in zip(self.threads, [{one} for one in self.pinned_to] if pin else self.free):
                os.sched_setaffinity(thread, processors)


places = Places()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: vars(places).update(vars(Places())))  # the threads are the parent's


def _tasks() -> set[int]:
    """The system's numbers of this process's threads; none where it does not tell."""
    with suppress(OSError):
        return set(map(int, os.listdir("/proc/self/task")))
    return set()


def _busy(processors: list[int]) -> float:
    """Seconds that these processors have worked for any program. Raises OSError where the system does not tell."""
    with open("/proc/stat", encoding="ascii") as file:
        fields = [line.split() for line in file if line.startswith("cpu")]
    ticks = {name: sum(map(int, counts[:3])) for name, *counts in fields}
    return sum(ticks.get(f"cpu{one}", 0) for one in processors) / os.sysconf("SC_CLK_TCK")


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads_for(rows: int) -> int:
    """CPU threads for loops over `rows`: one for ROWS_OF_A_THREAD of them, at least one, at most all.

    Waking a thread takes 20 to 200 microseconds, in which one does some hundred rows.
    """
    import numba

    return int(min(numba.config.NUMBA_NUM_THREADS, max(1, rows // ROWS_OF_A_THREAD)))
