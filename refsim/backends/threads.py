"""CPU threads: the layer that starts them, how many a loop gains from, their places. No result depends on these."""

import os
import time
from contextlib import suppress

ROWS_OF_A_THREAD = 1024
LOOK = 0.2  # [s] between looks at what other programs take
OTHERS = 0.25  # processors that they may take while each thread stays on its own


def choose_layer() -> None:
    """Have Numba start its threads by its own work queue, unless NUMBA_THREADING_LAYER names another layer.

    Called before the first loop, after which Numba keeps its layer. OpenMP's threads wait in a busy loop: where cores
    are shared, a barrier then takes milliseconds.
    """
    import numba

    if "NUMBA_THREADING_LAYER" not in os.environ:
        numba.config.THREADING_LAYER = "workqueue"


class Places:
    """Keeps each of Numba's threads on a processor of its own while other programs leave the processors alone.

    A virtual machine does not show which processors are idle. Linux then wakes a thread on the processor of the one
    that wakes it, and short loops of all threads take turns on one. Beside another program threads are free to move.

    threads  the system's numbers of Numba's threads; none where it does not tell, or where Numba started them before
    """

    def __init__(self) -> None:
        self.threads: list[int] = []
        self.pinned = False
        self.seen = (0.0, 0.0)  # time of the last look [s], and what other programs had taken [s of a processor]

    def use(self, number: int) -> None:
        """Have loops use so many of Numba's threads, which the first call starts."""
        import numba

        before = _tasks()
        numba.set_num_threads(number)
        self.threads = self.threads or sorted(_tasks() - before)

    def keep(self) -> None:
        """Pin the threads, or let them move, by what other programs took since the last look."""
        at, (before, taken) = time.perf_counter(), self.seen
        if not self.threads or at < before + LOOK:
            return
        import numba

        try:
            mask = sorted(os.sched_getaffinity(0))
            self.seen = at, _busy(mask) - time.process_time()
            alone = not before or self.seen[1] - taken < OTHERS * (at - before)
            pin = alone and len(mask) == len(self.threads) == numba.get_num_threads()
            if pin != self.pinned and _tasks().issuperset(self.threads):
                for k, thread in enumerate(self.threads):
                    os.sched_setaffinity(thread, mask[k : k + 1] if pin else mask)
                self.pinned = pin
        except (AttributeError, OSError, ValueError):  # a system without these
            self.threads = []


places = Places()


def _tasks() -> set[int]:
    """The system's numbers of this process's threads; none where it does not tell."""
    with suppress(OSError):
        return set(map(int, os.listdir("/proc/self/task")))
    return set()


def _busy(processors: list[int]) -> float:
    """Seconds that these processors have worked for any program. Raises OSError where the system does not tell."""
    with open("/proc/stat", encoding="ascii") as file:
        words = [line.split() for line in file if line.startswith("cpu")]
    ticks = {name: sum(map(int, counts[:3])) for name, *counts in words}
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
