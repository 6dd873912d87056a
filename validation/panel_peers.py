"""Panels by SPlisHSPlasH (DFSPH): the surge front, and the drop that was a cube under Akinci et al. 2013."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.study.panels.observables import FALL, kept
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.peers import splishsplash
from validation.results import Result
from validation.running import Context
from validation.turns import Outcome, Settings, in_turns

WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)


def fronts(context: Context, settings: Settings, threads: int, repeats: int) -> Result:
    """Mean front over t sqrt(2g/L) from 1 to 3 of every column, with refsim's kinematic viscosity."""

    def front(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
        width, columns = 0.5 * HEIGHT, setting["columns"]
        found = splishsplash.run_column(
            {
                "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": STEP,
                "viscosity": viscosity(width / columns) / DENSITY, "shake": repeat,
                "times": (FALL * np.arange(0.0, 4.625, 0.05)).tolist(),
            },
            threads,
        )  # fmt: skip
        if "missing" in found:
            return Outcome(stopped=f"missing: {found['missing']}")
        place = np.interp(np.linspace(1.0, 3.0, 41), np.array(found["time"]) / FALL, np.array(found["front"]) / width)
        return Outcome(float(place.mean()), found["wall"][-1], found["steps"], found["particles"])

    return in_turns(context, settings, front, threads, repeats, "peer")


def drops(context: Context, settings: Settings, threads: int, repeats: int) -> Result:
    """Radius variation that every drop keeps, and the seconds after which it does."""

    def drop(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
        found = splishsplash.run_drop({**setting["settings"], "shake": repeat}, threads)
        if "missing" in found:
            return Outcome(stopped=f"missing: {found['missing']}")
        value = kept(np.array(found["time"]), found["error"])
        above = [k for k, error in enumerate(found["error"]) if not error <= value]
        torn = "" if np.isfinite(value) else "torn: no outer surface all around"
        seconds = found["wall"][above[-1] + 1 if above else 0]
        return Outcome(value, seconds, found["steps"], found["particles"], torn)

    return in_turns(context, settings, drop, threads, repeats, "peer")
