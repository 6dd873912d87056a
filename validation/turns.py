"""Settings of an accuracy panel that take turns: repeats of all of them, in a random order within each round."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from validation.reading import Reading, measured
from validation.results import Result
from validation.running import Context
from validation.work_precision import REPEATS, unsettled

LASTS = 0.05  # s of a reading, at least: it repeats what takes less
WAITS = 1.0  # s after which a reading ends all the same, for what surrounds the timed part
MOST = 4  # times as many rounds as there are repeats, after which a time that has not settled is left

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
    """Readings of each key, in a random order within each round: what `once(key, round)` gave, until its `seconds` add
    up to LASTS.

    After `repeats` rounds those keys go on whose time has not settled, up to MOST times as many rounds. Fewer than
    REPEATS are no statistics: then a reading is one call, and there are no more rounds.
    """
    found: dict[str, list[list[T]]] = {key: [] for key in keys}
    enough = repeats >= REPEATS
    order = np.random.default_rng(0)
    for k in range(MOST * repeats if enough else repeats):
        left = [key for key, readings in found.items() if k < repeats or _open(readings, seconds)]
        for key in order.permutation(left).tolist():
            began, reading = time.perf_counter(), [once(key, k)]
            while enough and sum(map(seconds, reading)) < LASTS and time.perf_counter() - began < WAITS:
                reading.append(once(key, k))
            found[key].append(reading)
        context.progress(min((k + 1) / repeats, 1.0))
    return found


def _open(readings: Sequence[Sequence[T]], seconds: Callable[[T], float]) -> bool:
    """Whether more readings may settle a time: none was taken where a run stopped at once."""
    spent = [mean(map(seconds, reading)) for reading in readings]
    return all(spent) and bool(unsettled(spent))


def mean(values: Iterable[float]) -> float:
    """Arithmetic mean."""
    return float(np.mean(list(values)))


def mean_parts(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Mean of each name's values; 0 where one has no such name."""
    names = dict.fromkeys(name for each in parts for name in each)
    return {name: mean(each.get(name, 0.0) for each in parts) for name in names}


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
        spent = [mean(run.seconds for run in reading) for reading in found[key]]
        readings.append(
            Reading(
                key, setting["words"], setting["knobs"],
                error=math.nan if stopped else float(np.median([run.error for run in runs])),
                value=math.nan if stopped else float(np.median([run.value for run in runs])),
                seconds=spent, per_step=[seconds / max(run.steps, 1) for seconds, run in zip(spent, runs)],
                parts={"stepping": spent}, stopped=stopped, particles=runs[0].particles, steps=runs[0].steps,
                launches=runs[0].launches, bytes=runs[0].bytes, shown=setting.get("shown", True),
            )
        )  # fmt: skip
    return measured(readings, threads, backend)
