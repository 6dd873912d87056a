"""Panels by SPlisHSPlasH (DFSPH): the surge front, and the drop that was a cube under Akinci et al. 2013."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from refsim.study.panels.observables import FALL, kept
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.peers import splishsplash
from validation.reading import Reading, measured
from validation.results import Result
from validation.running import Context
from validation.turns import rounds

WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)
Settings = Mapping[str, Mapping[str, Any]]
Once = Callable[[Mapping[str, Any], int, int], dict[str, Any]]


def fronts(context: Context, settings: Settings, threads: int, repeats: int) -> Result:
    """Mean front over t sqrt(2g/L) from 1 to 3 of every column, with refsim's kinematic viscosity."""
    return _in_turns(context, settings, threads, repeats, _front)


def _front(setting: Mapping[str, Any], threads: int, repeat: int) -> dict[str, Any]:
    width, columns = 0.5 * HEIGHT, setting["columns"]
    times = FALL * np.arange(0.0, 4.625, 0.05)
    found = splishsplash.run_column(
        {
            "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": STEP,
            "viscosity": viscosity(width / columns) / DENSITY, "shake": repeat, "times": times.tolist(),
        },
        threads,
    )  # fmt: skip
    if "missing" in found:
        return found
    front = np.interp(np.linspace(1.0, 3.0, 41), np.array(found["time"]) / FALL, np.array(found["front"]) / width)
    return {**found, "value": float(front.mean()), "seconds": found["wall"][-1]}


def drops(context: Context, settings: Settings, threads: int, repeats: int) -> Result:
    """Radius variation that every drop keeps, and the seconds after which it does."""
    return _in_turns(context, settings, threads, repeats, _drop)


def _drop(setting: Mapping[str, Any], threads: int, repeat: int) -> dict[str, Any]:
    found = splishsplash.run_drop({**setting["settings"], "shake": repeat}, threads)
    if "missing" in found:
        return found
    value = kept(np.array(found["time"]), found["error"])
    above = [k for k, error in enumerate(found["error"]) if not error <= value]
    return {**found, "value": value, "seconds": found["wall"][above[-1] + 1 if above else 0]}


def _in_turns(context: Context, settings: Settings, threads: int, repeats: int, once: Once) -> Result:
    found = rounds(
        context, settings, lambda key, k: once(settings[key], threads, k), lambda run: run.get("seconds", 0.0), repeats
    )
    readings = []
    for key, setting in settings.items():
        runs = [reading[0] for reading in found[key].runs]
        common = {"key": key, "words": setting["words"], "knobs": setting["knobs"], "expected": True}
        if why := next((run["missing"] for run in runs if "missing" in run), ""):
            readings.append(Reading(**common, stopped=f"missing: {why}"))
            continue
        value, seconds = float(np.median([run["value"] for run in runs])), [run["seconds"] for run in runs]
        stopped = "" if math.isfinite(value) else "torn: no outer surface all around"
        readings.append(
            Reading(
                **common, error=value, value=value, seconds=seconds, stopped=stopped, steps=runs[0]["steps"],
                per_step=[run["wall"][-1] / run["steps"] for run in runs], particles=runs[0]["particles"],
                noise=found[key].noise,
            )
        )  # fmt: skip
    return measured(readings, threads, "peer")
