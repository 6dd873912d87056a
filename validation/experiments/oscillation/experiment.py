"""Rayleigh: the frequency of the mode n = 2 of kicked drops, and the tension that it stands for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim import calibrate
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.oscillation import pictures
from validation.measure.drops import MODELS
from validation.measure.sigma_map import drop_run, map_run
from validation.results import real

MODEL = "akinci"
OTHERS = (4, 5, 6)  # seeds of drops that calibrate has not seen


def planned(options: Options) -> list[Run]:
    """The published map, and drops that are kicked now: with --quick one in 2D; else three there and three in 3D.

    Those in 3D have seeds that the map does not hold, so that they test the tension predicted by `calibrate`.
    """
    if options.quick:
        return [map_run(), drop_run(MODEL, 2, 16.0, kicked=True)]
    flat = [drop_run(MODEL, 2, 16.0, seed, kicked=True) for seed in (1, 2, 3)]
    return [map_run(), *flat, *(drop_run(MODEL, 3, 10.0, seed, kicked=True) for seed in OTHERS)]


def measured_now(results: Results, dim: int | None = None) -> list[dict[str, Any]]:
    """Rows of the drops that were kicked now, of one dimension or of both."""
    rows = [dict(result.values) for key, result in results.items() if key != "map"]
    return [row for row in rows if dim in (None, row["dim"])]


def checks(results: Results, check: Checks) -> None:
    """How well a damped sine describes the drop is judged; tension and damping are shown."""
    for key, result in results.items():
        if key == "map":
            continue
        row = result.values
        words = f"{MODELS[row['model']][0]}, {row['dim']}D, seed {row['seed']}, measured now"
        for name in ("rayleigh", "misfit"):
            check(name, row.get(name), key, words)
        check("over_laplace", real(row.get("rayleigh")) / real(row["laplace"]), key, words)
        if row["seed"] in OTHERS and not row["stopped"]:
            for name, value in requested(row).items():
                check("requested", value, f"{key}.{name}", f"{name}, seed {row['seed']}")
        check("damping", real(row.get("damping")) / real(row.get("lamb")), key, words)
    for dim in (2, 3):
        found = [real(row.get("rayleigh")) for row in measured_now(results, dim) if not row["stopped"]]
        if len(found) > 1:
            words = f"{MODELS[MODEL][0]}, {dim}D, {len(found)} seeds"
            share = float(np.std(found, ddof=1) / np.mean(found))
            check("seed_spread", share, f"{MODEL}_{dim}d", words)


def requested(row: Mapping[str, Any]) -> dict[str, float]:
    """Relative difference of both tensions of a drop from the one requested of `calibrate`."""
    place = {"dim": row["dim"], "radius": row["radius"], "spacing": 1.0, "rest_density": 1.0}
    ratio = calibrate(1.0, row["model"], **place).ratio  # measured over nominal tension
    return {name.capitalize(): abs(row[name] / ratio - 1) for name in ("laplace", "rayleigh")}


EXPERIMENT = Experiment(
    name="oscillation",
    title="frequency of kicked drops, mode n = 2, every model: tension by Rayleigh",
    runs=planned,
    checks=checks,
    pictures=(Picture("oscillation", pictures.data, pictures.picture, ("map",)),),
)
