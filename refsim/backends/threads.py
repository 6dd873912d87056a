"""CPU threads: the layer that starts them, and how many a loop gains from. No result depends on either."""

import os

ROWS_OF_A_THREAD = 1024


def choose_layer() -> None:
    """Have Numba start its threads by its own work queue, unless NUMBA_THREADING_LAYER names another layer.

    Called before the first loop, after which Numba keeps its layer. OpenMP's threads wait in a busy loop: where cores
    are shared, a barrier then takes milliseconds.
    """
    import numba

    if "NUMBA_THREADING_LAYER" not in os.environ:
        numba.config.THREADING_LAYER = "workqueue"


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def threads_for(rows: int) -> int:
    """CPU threads for loops over `rows`: one for ROWS_OF_A_THREAD of them, at least one, at most all.

    Waking a thread takes 20 to 200 microseconds, in which one does some hundred rows.
    """
    import numba

    return int(min(numba.config.NUMBA_NUM_THREADS, max(1, rows // ROWS_OF_A_THREAD)))
