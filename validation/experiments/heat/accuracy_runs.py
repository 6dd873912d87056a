"""What the panels of melting measure: Stefan's front and the time in which a ball melts, against wall time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from refsim.backends.arrays import choose, set_threads
from validation.experiments.heat.runs import melting_sphere, stefan
from validation.results import Result
from validation.running import Context
from validation.turns import Once, Outcome, in_turns


def front(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """The melted depth's largest error [%], from the first held layer on."""
    backend = setting["knobs"]["backend"]
    found = stefan(Context(), setting["scheme"], setting["cells"], (setting["number"],), backend)
    (row,) = found.values["rows"]
    particles = len(found.arrays["x"]) * 36
    steps = round(found.values["until"] / (row["number"] * row["size"] ** 2))
    return Outcome(row["shifted"], row["shifted"], row["seconds"], steps, particles)


def melt_time(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """Time in which the ball melts, over that of the one-dimensional program, and its error [%]."""
    backend = setting["knobs"]["backend"]
    found = melting_sphere(Context(), setting["scheme"], setting["cells"], setting["number"], backend=backend).values
    wider = 1 + 0.5 / setting["cells"]  # lengths grow by this, times by its square
    share = found["melted"] / (found["melted_exactly"] * wider**2)
    steps = round(found["melted"] * setting["cells"] ** 2 / setting["number"])
    return Outcome(share, 100 * abs(share - 1), found["seconds"], steps, found["particles"])


def _panel(
    once: Once, context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None,
    repeats: int,
) -> Result:  # fmt: skip
    there = choose(backend)
    set_threads(there, threads)
    try:
        for setting in {s["scheme"]: s for s in settings.values()}.values():
            once(context, {**setting, "cells": 4}, 0)  # compiles
        return in_turns(context, settings, once, threads, repeats, backend)
    finally:
        set_threads(there, None)


def fronts(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn: `front`."""
    return _panel(front, context, settings, backend, threads, repeats)


def melt_times(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn: `melt_time`."""
    return _panel(melt_time, context, settings, backend, threads, repeats)
