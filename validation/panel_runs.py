"""Readings of panels that no packaged scene gives: drops that are stirred first, and those of SPlisHSPlasH."""

from __future__ import annotations

import math
import time

import numpy as np

from refsim import calibrate_contact_angle
from refsim.study.panels import Point
from refsim.study.panels.observables import FALL, kept
from refsim.study.runs import Reading
from refsim.surface_tension.calibration import sigma_map
from validation.experiments.dam_break.runs import DENSITY, HEIGHT, LID, viscosity
from validation.measure import drops, wetting
from validation.peers import splishsplash
from validation.reading import reading

SEED = 10  # of the first repeat of a drop: the maps hold seeds 1 to 3
ANGLE = 90.0  # requested [degrees]
WALLED = 15.0  # column widths: the tank of the front
STEP = 2e-3  # s, the longest of the front, which SPlisHSPlasH shortens by the speed (CFL number 0.5)


def flat_tension(model: str) -> tuple[float, float]:
    """Tension of a flat surface over the nominal one in 2D, and its standard error, from the map's pressure jumps."""
    entry = next(e for e in sigma_map() if e["model"] == model and e["dim"] == 2 and drops.at_base(model, e))
    return entry["flat_laplace"], entry["flat_laplace_error"]


def drop(point: Point, repeat: int, threads: int | None) -> Reading:
    """A drop of its own seed: R P over the flat tension, or its frequency over Lamb's with the flat tension."""
    by, model, knobs = point.setting["by"], point.setting["model"], point.knobs
    how = {"backend": knobs["backend"], "dtype": knobs["dtype"], "kicked": by == "rayleigh"}
    began = time.perf_counter()
    row = drops.measure(
        drops.Point(model, 2, radius=point.setting["radius"], seed=SEED + repeat, **how, **drops.base(model))
    )
    spent = time.perf_counter() - began
    if row["stopped"]:
        return reading(seconds=spent, particles=row.get("particles", 0), failed=row["stopped"])
    share = row[by] / flat_tension(model)[0]
    value = math.sqrt(max(share, 0.0)) if by == "rayleigh" else share
    return reading(value, spent, row["steps"], row["particles"])


def sessile(point: Point, repeat: int, threads: int | None) -> Reading:
    """A drop of its own seed on a plane, stirred, at rest and observed: its angle [degrees]."""
    found = calibrate_contact_angle(ANGLE, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    backend = point.knobs["backend"]
    began = time.perf_counter()
    row = wetting.measure(wetting.Point(found.share, 2, radius=point.setting["radius"], seed=SEED + repeat), backend)
    spent = time.perf_counter() - began
    if row["stopped"] or row["fate"] != "cap":
        why = row["stopped"] or f"{row['fate']}: no cap"
        return reading(seconds=spent, particles=row.get("particles", 0), failed=why)
    return reading(row["angle"], spent, row["steps"], row["particles"])


def front_by_splishsplash(point: Point, repeat: int, threads: int | None) -> Reading:
    """Mean front over t sqrt(2g/L) from 1 to 3 by DFSPH, with refsim's kinematic viscosity."""
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
