"""A millimetre of water with coefficients from `calibrate`: measured against requested tension [N/m]."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.water_drop import pictures, runs
from validation.measure.drops import MODELS

KERNELS = ("wendland", "mueller")
UNSEEN = (4, 5, 6)  # seeds that are not in the map
CELLS = {2: 16.0, 3: 10.0}  # radius in spacings


def planned(options: Options) -> list[Run]:
    """Three drops with each set of kernels in 3D; with --quick one in 2D."""
    if options.quick:
        return [_run("mueller", 2, UNSEEN[0])]
    return [_run(kernels, 3, seed) for kernels in KERNELS for seed in UNSEEN]


def _run(kernels: str, dim: int, seed: int) -> Run:
    drop: dict[str, Any] = {"model": "akinci", "kernels": kernels, "dim": dim, "cells": CELLS[dim], "seed": seed}
    return Run(f"{kernels}_{dim}d_{seed}", runs.drop, drop, estimate=6.0 if dim == 2 else 30.0)


def words_of(row: dict[str, Any]) -> str:
    """The drop in words."""
    return f"{MODELS[row['model']][0]}, {row['kernels']}, {row['dim']}D, seed {row['seed']}"


def off(row: dict[str, Any]) -> dict[str, float]:
    """Relative difference of both tensions from the requested one."""
    return {name: row[name] / row["asked"] - 1 for name in ("laplace", "rayleigh")}


def checks(results: Results, check: Checks) -> None:
    """Both tensions against the requested one, against each other, and against the uncertainty of `calibrate`."""
    for key, result in results.items():
        row = dict(result.values)
        if row["stopped"]:
            continue
        words = words_of(row)
        for name, share in off(row).items():
            check("tension", row[name], f"{key}.{name}", f"{words}, {name.capitalize()}")
            bound = "requested" if row["dim"] == 3 else "requested_2d"
            check(bound, abs(share), f"{key}.{name}", f"{words}, {name.capitalize()}")
            sure = abs(share) / row["uncertainty"]
            check("deviations", sure, f"{key}.{name}", f"{words}, {name.capitalize()}")
        both = row["laplace"] + row["rayleigh"]
        check("apart", 2 * abs(row["laplace"] - row["rayleigh"]) / both, key, words)
        check("misfit", row["misfit"], key, words)


EXPERIMENT = Experiment(
    name="water_drop",
    title="a millimetre of water, coefficients from calibrate(0.0728 N/m): jump and frequency against the request",
    runs=planned,
    checks=checks,
    pictures=(Picture("water_drop", pictures.data, pictures.picture),),
)
