"""Independent tasks on the processes of one machine, or on the workers of a Dask scheduler, behind one call.

Contents: perform; the modules tasks (Task, Outcome), pool (processes of this machine) and scheduler (Dask distributed).
"""

from collections.abc import Callable, Generator, Sequence

from refsim.backends.threads import cores
from refsim.cluster.tasks import Outcome, Task, Watch
from refsim.core.errors import InputError


def perform(
    tasks: Sequence[Task],
    *,
    jobs: int | None = None,
    scheduler: str | None = None,
    watch: Watch = lambda shares, workers: None,
    say: Callable[[str], None] = lambda text: None,
) -> Generator[Outcome, None, None]:
    """Outcomes of the tasks in the order in which they end; what is under way when they are closed ends, too.

    jobs       processes of this machine, of one thread each; as many as it has processors by default
    scheduler  address of a Dask scheduler, whose workers do the tasks instead
    watch      is called about twice a second with {key: share done} of the tasks under way and the number of workers
    say        is called with a line when the last worker of a scheduler is lost; the tasks wait for another one

    A task whose process is killed is begun anew in another one, `ATTEMPTS` times at most. Raises InputError for bad
    input, such as an address where no scheduler answers, and RunStopped("scheduler_lost") where it goes away.
    """
    if not tasks:
        return (outcome for outcome in list[Outcome]())
    if scheduler is not None:
        from refsim.cluster.scheduler import by_scheduler

        return by_scheduler(tasks, scheduler, watch, say)
    count = cores() if jobs is None else jobs
    if count < 1:
        raise InputError(f"--jobs = {count} is not possible; give 1 or more processes.")
    from refsim.cluster.pool import by_processes

    return by_processes(tasks, count, watch)
