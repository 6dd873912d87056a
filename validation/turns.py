"""Settings of an accuracy panel that take turns: repeats of all of them, in a random order within each round."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, Generic, TypeVar

import numpy as np

from refsim.study.choice import REPEATS, unsettled
from validation.reading import environment
from validation.results import Result
from validation.running import Context

LASTS = 0.05  # s of a run, at least: what takes less is repeated within it
WAITS = 1.0  # s after which a run ends all the same, for what surrounds the timed part
MOST = 8  # times as many rounds as there are readings, after which a time that has not settled is left
PATIENCE = 10.0  # s that a setting has taken in all, preparation included, after which it is left, too

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """What one run of a setting gave.

    value         the observable
    seconds       wall seconds that count, without first calls
    stopped       why it came to no end, "missing: ..." where another program is not installed; "" if it did
    bytes         of fields a particle
    """

    value: float = math.nan
    seconds: float = 0.0
    steps: int = 0
    particles: int = 0
    stopped: str = ""
    bytes: int | None = None


Settings = Mapping[str, Mapping[str, Any]]  # by key of the panel's point: its knobs and what else it was set to
Once = Callable[[Context, Mapping[str, Any], int], Outcome]
PanelRun = Callable[[Context, Settings, str, int | None, int], Result]  # of settings, backend, threads, repeats


@dataclass(frozen=True)
class Readings(Generic[T]):
    """What one setting gave.

    runs   for each reading, which may be a start of its own, the runs that count
    noise  seconds over what they should equal: of each reading over their mean; from two rounds on of alternate rounds
           of a reading over the mean of both, since starts may differ in what they cost
    """

    runs: list[list[T]]
    noise: list[float]

    def means(self, seconds: Callable[[T], float]) -> list[float]:
        """Mean seconds of each reading."""
        return [mean(map(seconds, runs)) for runs in self.runs]


def rounds(
    context: Context, keys: Iterable[str], once: Callable[[str, int], T], seconds: Callable[[T], float], repeats: int
) -> dict[str, Readings[T]]:
    """`repeats` readings of each key, of what `once(key, reading)` gave.

    The order is drawn anew in each round. Within a round a key is run until its `seconds` add up to LASTS. As many
    rounds again follow for keys whose times have not settled, up to MOST times; a run adds to the reading of its
    number, so that each reading spreads over the whole session. The middle third of its runs counts: what disturbs the
    machine makes some of them slower. Fewer than REPEATS readings are no statistics: then each is one run.
    """
    found: dict[str, list[list[list[T]]]] = {key: [[] for _ in range(repeats)] for key in keys}
    order, left, enough = np.random.default_rng(0), list(found), repeats >= REPEATS
    taken = dict.fromkeys(found, 0.0)
    for again in range(MOST if enough else 1):
        for k in range(repeats):
            for key in order.permutation(left).tolist():
                began, runs = time.perf_counter(), [once(key, k)]
                while enough and 0 < sum(map(seconds, runs)) < LASTS and time.perf_counter() - began < WAITS:
                    runs.append(once(key, k))
                found[key][k].append(runs)
                taken[key] += time.perf_counter() - began
            context.progress((again + (k + 1) / repeats) / (MOST if enough else 1))
        left = [key for key in left if taken[key] < PATIENCE and _open(_noise(found[key], seconds))]
    return {
        key: Readings([_counted(turns, seconds) for turns in numbers], _noise(numbers, seconds))
        for key, numbers in found.items()
    }


def _counted(turns: Iterable[Iterable[T]], seconds: Callable[[T], float]) -> list[T]:
    """The runs of several rounds that count."""
    return middle_third(chain.from_iterable(turns), seconds)


def _noise(numbers: Sequence[Sequence[Sequence[T]]], seconds: Callable[[T], float]) -> list[float]:
    """See `Readings`; 0 where no time passed."""

    def relative(groups: Iterable[Iterable[Iterable[T]]]) -> list[float]:
        spent = [mean(map(seconds, _counted(turns, seconds))) for turns in groups]
        return [each / (mean(spent) or 1.0) for each in spent]

    if len(numbers[0]) == 1:
        return relative(numbers)
    return [share for turns in numbers for share in relative((turns[::2], turns[1::2]))]


def _open(noise: Sequence[float]) -> bool:
    """Whether a time has not settled; what stopped at once has none."""
    return all(noise) and bool(unsettled(noise))


def middle_third(runs: Iterable[T], seconds: Callable[[T], float]) -> list[T]:
    """The runs of a reading without its fastest third and its slowest one; one or two runs as they are."""
    ordered = sorted(runs, key=seconds)
    cut = len(ordered) // 3
    return ordered[cut : len(ordered) - cut]


def mean(values: Iterable[float]) -> float:
    """Arithmetic mean."""
    return float(np.mean(list(values)))


def in_turns(context: Context, settings: Settings, once: Once, threads: int | None, repeats: int, backend: str = "cpu"
             ) -> Result:  # fmt: skip
    """Readings of all settings, each of what `once(context, setting, repeat)` gave."""
    found = rounds(context, settings, lambda key, k: once(context, settings[key], k), lambda run: run.seconds, repeats)
    return measured(found, threads, backend)


def panel(once: Once, warm: Callable[[Context, Mapping[str, Any]], Any] = lambda context, setting: None) -> PanelRun:
    """A panel's run: `warm` compiles what each setting calls, then the settings take turns."""

    def run(context: Context, settings: Settings, backend: str, threads: int | None, repeats: int) -> Result:
        for setting in settings.values():
            warm(context, setting)
        return in_turns(context, settings, once, threads, repeats, backend)

    return run


def measured(found: Mapping[str, Readings[Outcome]], threads: int | None, backend: str) -> Result:
    """The result of a panel's run: a reading of each setting, and where they were measured.

    A reading is its first outcome, with seconds (in all, of a step) one for each repeat, and their noise.
    """
    return Result({
        "readings": [{"key": key, **reading(own)} for key, own in found.items()],
        "where": environment(threads, backend),
    })  # fmt: skip


def reading(own: Readings[Outcome]) -> dict[str, Any]:
    """What one setting gave in all its runs."""
    firsts = [runs[0] for runs in own.runs]
    stopped = next((run.stopped for run in firsts if run.stopped), "")
    length = max(float(np.median([run.steps for run in firsts])), 1.0)  # where repeats differ in it

    def means(part: Callable[[Outcome], float]) -> list[float]:
        return [length * mean(part(run) / max(run.steps, 1) for run in runs) for runs in own.runs]

    seconds = means(lambda run: run.seconds)
    value = math.nan if stopped else float(np.median([run.value for run in firsts]))
    return {
        **asdict(firsts[0]), "value": value, "seconds": seconds, "stopped": stopped, "noise": own.noise,
        "per_step": [each / length for each in seconds],
    }  # fmt: skip
