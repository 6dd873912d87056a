"""Young & Laplace: the pressure jump of drops at rest against their curvature, for every model of surface tension."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.laplace import pictures
from validation.measure.drops import MODELS, SEEDED, fit_laplace
from validation.measure.sigma_map import at_base, drop_run, map_run, words_of
from validation.results import real

LARGE = 10.0  # radius in spacings from which on the target holds
LEADING = "akinci"  # the model that calibrate takes where none is named
MEASURED = {2: (8.0, 11.0, 16.0, 24.0), 3: (8.5, 10.0, 12.0, 14.0)}  # radii in spacings, of R >= 3 h


def planned(options: Options) -> list[Run]:
    """The published map, and drops of four radii (three with --quick, in 2D only) measured now, three seeds of one."""
    made = [map_run()]
    for dim, radii in MEASURED.items():
        if options.quick and dim == 3:
            continue
        for radius in radii[:3] if options.quick else radii:
            seeds = (1, 2, 3) if radius == SEEDED[dim] and not options.quick else (1,)
            made += [drop_run(LEADING, dim, radius, seed) for seed in seeds]
    return made


def measured_now(results: Results, dim: int | None = None) -> list[dict[str, Any]]:
    """Rows of the drops that were measured now, of one dimension or of both."""
    rows = [dict(result.values) for key, result in results.items() if key != "map"]
    return [row for row in rows if dim in (None, row["dim"])]


def checks(results: Results, check: Checks) -> None:
    """Every setting's tension is shown; how well the jump of the drops measured now follows 1/R is judged."""
    for dim in MEASURED:
        rows = measured_now(results, dim)
        if not rows:
            continue
        slope, error, intercept = fit_laplace(rows)
        name, words = f"{LEADING}_{dim}d", f"{MODELS[LEADING][0]}, {dim}D, measured now"
        check("sigma", slope, name, words)
        seeded = [row["laplace"] for row in rows if row["radius"] == SEEDED[dim] and not row["stopped"]]
        if len(seeded) > 1:
            share = float(np.std(seeded, ddof=1) / np.mean(seeded))
            check("seed_spread", share, name, f"{words}, {len(seeded)} seeds")
        check("fit_error", error / slope if slope else math.nan, name, words)
        largest = max(row["radius"] for row in rows if not row["stopped"])
        check("left_over", abs(intercept) * largest / ((dim - 1) * slope), name, words)
    for entry in settings(results):
        if at_base(entry) and math.isfinite(real(entry["laplace"])):
            name, words = f"map_{entry['model']}_{entry['dim']}d", words_of(entry)
            check("sigma", entry["laplace"], name, words)
    fits = {e["model"]: fit_apart(e) for e in settings(results) if e["dim"] == 3 and at_base(e)}
    for model, (value, error) in fits.items():
        check("agreement", value, model, f"{MODELS[model][0]}, fit +- {100 * error:.0f} %")
    for entry in settings(results):
        if entry["dim"] == 3 and at_base(entry):
            for drop in entry["drops_by_radius"]:
                if drop["radius"] >= LARGE:
                    words = f"{MODELS[entry['model']][0]}, R = {drop['radius']:g} d"
                    name = f"{entry['model']}_R{drop['radius']:g}"
                    check("agreement_drops", apart_by(drop), name, words)
    found = {name_of(e): farthest_apart(e) for e in settings(results) if e["dim"] == 3}
    known = {name: value for name, value in found.items() if math.isfinite(value)}
    if known:
        best = min(known, key=lambda name: known[name])
        check("best_agreement", known[best], "", best)


def name_of(entry: Mapping[str, Any]) -> str:
    """A setting in words."""
    place = f"h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}"
    return f"{MODELS[entry['model']][0]}, {place}"


def farthest_apart(entry: Mapping[str, Any]) -> float:
    """Largest |Laplace - Rayleigh| over their mean, of all radii of 10 spacings or more; NaN below three of them."""
    large = [apart_by(drop) for drop in entry["drops_by_radius"] if drop["radius"] >= LARGE]
    return max(large) if len(large) > 2 and all(map(math.isfinite, large)) else math.nan


def fit_apart(entry: dict[str, Any]) -> tuple[float, float]:
    """(|Laplace - Rayleigh| over their mean, relative standard error of the fit) of a setting: the jump of all its
    drops with R >= 3 h fitted against 1/R, and the mean frequency of those of 10 spacings or more."""
    slope = real(entry["laplace"])
    return apart_by(entry), real(entry["laplace_error"]) / slope if slope > 0 else math.nan


def settings(results: Results) -> list[dict[str, Any]]:
    """The map's entries."""
    return results["map"].values["settings"] if "map" in results else []


def apart_by(entry: Mapping[str, Any]) -> float:
    """|Laplace - Rayleigh| over their mean; NaN where one is missing or no tension at all."""
    laplace, rayleigh = real(entry["laplace"]), real(entry["rayleigh"])
    return abs(laplace - rayleigh) / (0.5 * (laplace + rayleigh)) if min(laplace, rayleigh) > 0 else math.nan


EXPERIMENT = Experiment(
    name="laplace",
    title="pressure jump of drops against 1/R, every model: what the surface tension really is",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("laplace", pictures.jump_data, pictures.jump_picture, ("map",)),
        Picture("sigma_map", pictures.map_data, pictures.map_picture, ("map",)),
    ),
)
