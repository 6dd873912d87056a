"""Readings of panels by SPlisHSPlasH (DFSPH): the surge front, and the drop that was a cube."""

from __future__ import annotations

import numpy as np

from refsim.study.panels import Point
from refsim.study.panels.observables import FALL, kept
from refsim.study.runs import Reading
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.peers import splishsplash
from validation.reading import reading

WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)


def front_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """Mean front over t sqrt(2g/L) from 1 to 3 by DFSPH, with the kinematic viscosity of the experiment `dam_break`."""
    width, columns = 0.5 * HEIGHT, point.setting["columns"]
    found = splishsplash.run_column(
        {
            "columns": columns, "width": width, "length": WALLED * width, "height": LID, "step": STEP,
            "viscosity": viscosity(width / columns) / DENSITY, "shake": repeat,
            "times": (FALL * np.arange(0.0, 4.625, 0.05)).tolist(),
        },
        threads or 2,
    )  # fmt: skip
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    place = np.interp(np.linspace(1.0, 3.0, 41), np.array(found["time"]) / FALL, np.array(found["front"]) / width)
    return reading(float(place.mean()), found["wall"][-1], found["steps"], found["particles"])


def drop_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """Radius variation that a drop keeps under Akinci et al. 2013, and the seconds after which it does."""
    found = splishsplash.run_drop({**point.setting["settings"], "shake": repeat}, threads or 2)
    if "missing" in found:
        return reading(failed=f"missing: {found['missing']}")
    value = kept(np.array(found["time"]), found["error"])
    above = [k for k, error in enumerate(found["error"]) if not error <= value]
    torn = "" if np.isfinite(value) else "torn: no outer surface all around"
    seconds = found["wall"][above[-1] + 1 if above else 0]
    return reading(value, seconds, found["steps"], found["particles"], torn)
