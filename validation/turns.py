"""Settings of an accuracy panel that take turns: repeats of all of them, in a random order within each round."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from validation.reading import Reading, environment, measured
from validation.results import Result
from validation.running import Context
from validation.work_precision import REPEATS, unsettled

LASTS = 0.05  # s of a run, at least: what takes less is repeated within it
WAITS = 1.0  # s after which a run ends all the same, for what surrounds the timed part
MOST = 8  # times as many rounds as there are readings, after which a time that has not settled is left
PATIENCE = 10.0  # s that a setting has taken in all, preparation included, after which it is left, too

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """What one run of a setting gave.

    value     the observable
    error     its distance from the reference, in the panel's unit
    seconds   wall seconds of stepping, without first calls
    stopped   why it came to no end; "" if it did
    launches, bytes  operations of a step, and bytes of fields a particle
    """

    value: float
    error: float
    seconds: float
    steps: int
    particles: int
    stopped: str = ""
    launches: int | None = None
    bytes: int | None = None


Once = Callable[[Context, Mapping[str, Any], int], Outcome]


def rounds(
    context: Context, keys: Iterable[str], once: Callable[[str, int], T], seconds: Callable[[T], float], repeats: int
) -> dict[str, list[list[T]]]:
    """`repeats` readings of each key: the runs that count for each, of what `once(key, reading)` gave.

    The order is drawn anew in each round. Within a round a key is run until its `seconds` add up to LASTS. As many
    rounds again follow for keys whose times have not settled, up to MOST times; a run adds to the reading of its
    number, so that each reading spreads over the whole session. The middle third of its runs counts: what disturbs the
    machine makes some of them slower. Fewer than REPEATS readings are no statistics: then each is one run.
    """
    found: dict[str, list[list[T]]] = {key: [[] for _ in range(repeats)] for key in keys}
    order, left, enough = np.random.default_rng(0), list(found), repeats >= REPEATS
    taken = dict.fromkeys(found, 0.0)
    for again in range(MOST if enough else 1):
        for k in range(repeats):
            for key in order.permutation(left).tolist():
                began, runs = time.perf_counter(), [once(key, k)]
                while enough and 0 < sum(map(seconds, runs)) < LASTS and time.perf_counter() - began < WAITS:
                    runs.append(once(key, k))
                found[key][k] += runs
                taken[key] += time.perf_counter() - began
            context.progress((again + (k + 1) / repeats) / (MOST if enough else 1))
        left = [key for key in left if taken[key] < PATIENCE and _open(found[key], seconds)]
    return {key: [middle_third(runs, seconds) for runs in readings] for key, readings in found.items()}


def _open(readings: Sequence[Sequence[T]], seconds: Callable[[T], float]) -> bool:
    """Whether a time has not settled; what stopped at once has none."""
    spent = [mean(map(seconds, middle_third(reading, seconds))) for reading in readings]
    return all(spent) and bool(unsettled(spent))


def middle_third(runs: Iterable[T], seconds: Callable[[T], float]) -> list[T]:
    """The runs of a reading without its fastest third and its slowest one; one or two runs as they are."""
    ordered = sorted(runs, key=seconds)
    cut = len(ordered) // 3
    return ordered[cut : len(ordered) - cut]


def mean(values: Iterable[float]) -> float:
    """Arithmetic mean."""
    return float(np.mean(list(values)))


def mean_parts(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each name's values; 0 where one has no such name."""
    names = dict.fromkeys(name for each in parts for name in each)
    return {name: mean(each.get(name, 0.0) for each in parts) for name in names}


def repeated(
    context: Context, settings: Mapping[str, Mapping[str, Any]], once: Callable[[Mapping[str, Any], int], Result],
    threads: int | None, repeats: int, backend: str = "cpu",
) -> Result:  # fmt: skip
    """Readings of settings whose every run is a result with one reading: of a number's runs the one in the middle.

    once  takes the setting and the repeat, which may be the seed of its start
    """
    compiling: dict[str, float | None] = {}

    def run(key: str, k: int) -> dict[str, Any]:
        (reading,) = once(settings[key], k).values["readings"]
        compiling.setdefault(key, reading["compile"])
        return reading

    def whole(reading: Mapping[str, Any]) -> float:
        return sum(reading["per_step"]) * reading["steps"]

    found = rounds(context, settings, run, whole, repeats)
    readings = [{**runs[0], "compile": compiling[key]} for key, numbers in found.items() for runs in numbers]
    return Result({"readings": readings, "where": environment(threads, backend)})


def in_turns(
    context: Context, settings: Mapping[str, Mapping[str, Any]], once: Once, threads: int | None, repeats: int,
    backend: str = "cpu",
) -> Result:  # fmt: skip
    """Readings of all settings.

    settings  key to {"words", "knobs", "shown" (True by default), ...}; `once` takes the setting and the repeat
    """
    found = rounds(context, settings, lambda key, k: once(context, settings[key], k), lambda run: run.seconds, repeats)
    readings = []
    for key, setting in settings.items():
        runs = [reading[0] for reading in found[key]]
        stopped = next((run.stopped for run in runs if run.stopped), "")
        length = float(np.median([run.steps for run in runs]))  # where repeats differ in it
        spent = [length * mean(run.seconds / max(run.steps, 1) for run in reading) for reading in found[key]]
        readings.append(
            Reading(
                key, setting["words"], setting["knobs"],
                error=math.nan if stopped else float(np.median([run.error for run in runs])),
                value=math.nan if stopped else float(np.median([run.value for run in runs])),
                seconds=spent, per_step=[seconds / max(length, 1.0) for seconds in spent],
                parts={"stepping": spent}, stopped=stopped, particles=runs[0].particles, steps=runs[0].steps,
                launches=runs[0].launches, bytes=runs[0].bytes, shown=setting.get("shown", True),
            )
        )  # fmt: skip
    return measured(readings, threads, backend)
