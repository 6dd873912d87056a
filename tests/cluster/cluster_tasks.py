"""What tests have done in other processes."""

import os
import signal
import time
from pathlib import Path

from refsim.core.errors import RunStopped
from refsim.study import tasks


def square(report, value):
    report(0.5)
    return value * value


def diverge(report):
    raise RunStopped("diverged", "In step 7 a particle moves with 1e9 m/s.")


def die(report):
    os.kill(os.getpid(), signal.SIGKILL)


def die_once(report, marker, value):
    if first_time(marker):
        os.kill(os.getpid(), signal.SIGKILL)
    return value, os.environ["NUMBA_NUM_THREADS"]


def numba_threads(report):
    """Threads of Numba when they have been launched and a kernel is compiled after that."""
    import numba
    from numba.np.ufunc.parallel import _launch_threads

    _launch_threads()

    @numba.njit
    def one():
        return 1

    return one() * numba.get_num_threads()


def device(report):
    return os.environ["CUDA_VISIBLE_DEVICES"]


def killed_run(report, work, marker, shares):
    """Compute a run; its first process is killed beyond half of it. The shares are written by process."""

    def tell(share):
        with open(shares, "a") as file:
            file.write(f"{os.getpid()} {share}\n")
        if share > 0.5 and first_time(marker):
            os.kill(os.getpid(), signal.SIGKILL)

    return tasks.compute(tell, work)


def wait(report, seconds):
    time.sleep(seconds)
    return seconds


def first_time(marker):
    try:
        Path(marker).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True
