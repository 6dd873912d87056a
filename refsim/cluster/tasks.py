"""A task, what became of it, and what both executors have in common."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from refsim.core.errors import RunStopped

ATTEMPTS = 4  # to compute a task whose process is killed
ONE_THREAD = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
Report = Callable[[float], None]  # is given the share done of a task, 0 to 1


@dataclass(frozen=True)
class Task:
    """`function(report, *arguments)` in another process; both are pickled, and functions travel by their names."""

    key: str  # digest of the task; no two tasks have the same
    name: str  # in messages and progress
    function: Callable[..., Any]
    arguments: tuple[Any, ...] = ()
    weight: float = 1.0  # work relative to that of the other tasks
    bytes: int = 0  # of memory that it needs; 0 if that is not known
    gpu: bool = False  # whether it needs a GPU of its own


@dataclass(frozen=True)
class Outcome:
    """What became of a task: its value, or the error that ended it; `seconds` of wall time and `worker` that did it."""

    task: Task
    value: Any = None
    error: BaseException | None = None
    seconds: float = 0.0
    worker: str = ""


Watch = Callable[[Mapping[str, float], int], None]


def killed(task: Task, times: int) -> RunStopped:
    """The error of a task whose processes were killed as often as that."""
    return RunStopped(
        "interrupted",
        f"{task.name}: {times} processes in turn were killed while they computed it, perhaps for want of memory; call"
        " the same command again, with fewer jobs or more memory.",
    )
