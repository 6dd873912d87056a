"""Progress of a sweep: share done, time left, seconds that the workers have taken so far."""

import time
from collections.abc import Callable, Mapping, Sequence

from refsim.cluster.tasks import Outcome, Task
from refsim.core.tables import in_time
from refsim.core.terminal import Bar


class Progress:
    """A bar over the weight of tasks, and a line for each that ends.

    task_seconds  sum of the seconds of ended tasks
    workers       most workers seen at one time
    """

    def __init__(self, tasks: Sequence[Task], shown: bool, say: Callable[[str], None]) -> None:
        least = max((task.weight for task in tasks), default=1.0) / 1000 or 1.0
        self.weights = {task.key: max(task.weight, least) for task in tasks}
        self.total, self.say = sum(self.weights.values()), say
        self.done = self.count = 0.0
        self.task_seconds, self.workers, self.began = 0.0, 0, time.perf_counter()
        self.bar = Bar(1.0, shown=shown and bool(tasks))

    def close(self) -> None:
        """Close the bar."""
        self.bar.close()

    def watch(self, shares: Mapping[str, float], workers: int) -> None:
        """The shares done of tasks under way."""
        self.workers = max(self.workers, workers)
        share = (self.done + sum(self.weights[key] * s for key, s in shares.items())) / self.total
        self.bar.to(share, f"{workers} workers, {in_time(self.task_seconds)} of theirs so far")

    def ended(self, outcome: Outcome) -> None:
        """A task has ended."""
        task, reading = outcome.task, outcome.value
        self.count += 1
        self.done += self.weights[task.key]
        self.task_seconds += outcome.seconds
        gone = time.perf_counter() - self.began
        left = gone * (self.total - self.done) / self.done
        if outcome.error is not None:
            outcome_text = f"not computed: {outcome.error}"
        elif reading.failed:
            outcome_text = reading.failed
        else:
            outcome_text = f"{reading.value:.6g} in {in_time(outcome.seconds)}"
        rest = f"; about {in_time(left)} left" if self.count < len(self.weights) else ""
        self.say(f"{self.count:.0f} of {len(self.weights)}, {task.name}: {outcome_text}{rest}")
