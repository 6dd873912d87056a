"""What the accuracy panel of heat measures: the error of a slab's cosine against passes and seconds."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.backends.arrays import choose, set_threads
from validation.experiments.heat.conductor import Conductor, lattice
from validation.experiments.heat.exact import cosine
from validation.reading import Reading, distribution, measured
from validation.results import Result
from validation.running import Context

ACROSS = 10  # spacings; the same particles for every scheme
LENGTH, UNTIL = 4.0, 1.6  # [m], [s]: 40 units of k t/(rho c d^2) at 20 spacings


def started(setting: Mapping[str, Any]) -> tuple[Conductor, np.ndarray, int]:
    """A setting's slab, the depth of its particles [m], and its number of steps."""
    cells, spacing = setting["cells"], LENGTH / setting["cells"]
    position = lattice((cells, ACROSS, ACROSS), spacing)
    period = (0.0, ACROSS * spacing, ACROSS * spacing)
    x = position[:, 0]
    dtype = setting["knobs"]["dtype"]
    made = Conductor(
        setting["scheme"], position, spacing, cosine(x, LENGTH, 0.0), period=period, dtype=dtype, **setting["options"]
    )
    return made, x, max(1, round(UNTIL / (setting["number"] * spacing**2)))


def slabs(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn: rms error of the cosine [% of the range] and seconds of stepping.

    settings  key to {"words", "knobs" (with "dtype"), "scheme", "cells", "number", "options", "shown"}
    """
    there = choose("cpu")
    set_threads(there, threads)
    spent: dict[str, list[float]] = {key: [] for key in settings}
    ended, compiling, passes = {}, {}, {}
    try:
        for key, setting in settings.items():
            began = time.perf_counter()
            made, _, steps = started(setting)
            made.step(UNTIL / steps)
            compiling[key] = time.perf_counter() - began
            passes[key] = started(setting)[0].passes(UNTIL / steps)
        order = np.random.default_rng(0)
        for k in range(repeats):
            for key in order.permutation(list(settings)).tolist():
                if k and not settings[key]["shown"]:
                    continue
                made, x, steps = started(settings[key])
                made.run(UNTIL, steps)
                spent[key].append(made.seconds)
                ended[key] = made.temperature.astype(float) - cosine(x, LENGTH, UNTIL)
            context.progress((k + 1) / repeats)
    finally:
        set_threads(there, None)
    readings = []
    for key, setting in settings.items():
        steps, error = started(setting)[2], float(np.sqrt((ended[key] ** 2).mean()))
        lost = not error < 1e3
        readings.append(
            Reading(
                key, setting["words"],
                {**setting["knobs"], "passes": passes[key] * steps / (UNTIL / 0.04)},
                error=math.nan if lost else error, value=math.nan if lost else error, seconds=spent[key],
                per_step=[seconds / steps for seconds in spent[key]], parts={"stepping": spent[key]},
                compile=compiling[key], distribution={} if lost else {"|T - exact| [deg C]": distribution(ended[key])},
                stopped="blown up: unstable beyond s = 1" if lost else "", expected=lost, particles=len(ended[key]),
                steps=steps, shown=setting["shown"],
            )
        )  # fmt: skip
    return measured(readings, threads, backend)
