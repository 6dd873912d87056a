"""Settings of an accuracy panel that take turns: repeats of all of them, in a random order within each round."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from validation.reading import Reading, measured
from validation.results import Result
from validation.running import Context


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


def in_turns(
    context: Context, settings: Mapping[str, Mapping[str, Any]], once: Once, threads: int | None, repeats: int,
    backend: str = "cpu",
) -> Result:  # fmt: skip
    """Readings of all settings.

    settings  key to {"words", "knobs", "shown" (True by default), ...}; `once` takes the setting and the repeat
    """
    found: dict[str, list[Outcome]] = {key: [] for key in settings}
    order = np.random.default_rng(0)
    for k in range(repeats):
        for key in order.permutation(list(settings)).tolist():
            found[key].append(once(context, settings[key], k))
        context.progress((k + 1) / repeats)
    readings = []
    for key, setting in settings.items():
        runs = found[key]
        stopped = next((run.stopped for run in runs if run.stopped), "")
        spent = [run.seconds for run in runs]
        readings.append(
            Reading(
                key, setting["words"], setting["knobs"],
                error=math.nan if stopped else float(np.median([run.error for run in runs])),
                value=math.nan if stopped else float(np.median([run.value for run in runs])),
                seconds=spent, per_step=[run.seconds / max(run.steps, 1) for run in runs],
                parts={"stepping": spent}, stopped=stopped, particles=runs[0].particles, steps=runs[0].steps,
                launches=runs[0].launches, bytes=runs[0].bytes, shown=setting.get("shown", True),
            )
        )  # fmt: skip
    return measured(readings, threads, backend)
