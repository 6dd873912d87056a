"""A millimetre of water with coefficients from `calibrate`: measured against requested tension [N/m]."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.water_drop import pictures, runs
from validation.measure.drops import MODELS
from validation.tables import Table

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


def tables(results: Results) -> list[Table]:
    """Every drop in SI units."""
    rows: list[list[Any]] = []
    for result in results.values():
        row = dict(result.values)
        if row["stopped"]:
            rows.append([words_of(row), *[None] * 7, row["stopped"]])
            continue
        shares = off(row)
        rows.append(
            [
                words_of(row),
                f"{1e3 * row['nominal']:.2f}",
                f"{row['jump']:.1f}",
                *(cell for name in shares for cell in (f"{1e3 * row[name]:.2f}", f"{100 * shares[name]:+.1f} %")),
                f"{row['frequency']:.2f} ({row['asked_frequency']:.2f})",
                f"{100 * row['uncertainty']:.1f} %",
                "",
            ]
        )
    heading = ["drop", "nominal", "jump, Pa", "Laplace", "off", "Rayleigh", "off", "Hz (requested)", "+-", "stopped"]
    note = (
        f"Radius 1 mm, {1e3 * runs.TENSION:g} mN/m requested; tensions in mN/m. +-: what `calibrate` states. Viscosity"
        f" {1e3 * runs.THIN:g} mPa s."
    )
    return [Table("A drop of water, coefficients from calibrate", heading, rows, note)] if rows else []


EXPERIMENT = Experiment(
    name="water_drop",
    title="a millimetre of water, coefficients from calibrate(0.0728 N/m): jump and frequency against the request",
    runs=planned,
    checks=checks,
    pictures=(Picture("water_drop", pictures.data, pictures.picture),),
    tables=tables,
)
