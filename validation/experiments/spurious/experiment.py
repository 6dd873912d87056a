"""Drops at rest: spurious speed, momentum, clustering."""

from __future__ import annotations

import itertools
import math
from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.spurious import pictures
from validation.measure.drops import MODELS
from validation.measure.sigma_map import WORST, at_base, drop_run, map_run
from validation.results import real
from validation.tables import Table

NAMES = ("spurious", "capillary", "momentum", "angular_momentum", "nn_5", "roughness")
MEASURED = ("akinci", "jiang_zhu", "dong")
RADIUS = {2: 8.0, 3: 8.5}


def planned(options: Options) -> list[Run]:
    """The published map, and drops measured now: three models and three seeds in 2D and 3D, one drop with --quick."""
    if options.quick:
        return [map_run(), drop_run(MEASURED[0], 2, RADIUS[2])]
    every = itertools.product(RADIUS.items(), MEASURED, (1, 2, 3))
    return [map_run(), *(drop_run(model, dim, radius, seed) for (dim, radius), model, seed in every)]


def measured_now(results: Results) -> dict[tuple[str, int], list[dict[str, Any]]]:
    """Rows of the drops that were measured now, by model and dimension; without those that stopped."""
    groups: dict[tuple[str, int], list[dict[str, Any]]] = {}
    for key, result in results.items():
        if key != "map" and not result.values["stopped"]:
            row = dict(result.values)
            groups.setdefault((row["model"], row["dim"]), []).append(row)
    return groups


def checks(results: Results, check: Checks) -> None:
    """The worst seed of each model: linear momentum, which all of them keep, is judged; the rest is shown."""
    for (model, dim), rows in measured_now(results).items():
        words = f"{MODELS[model][0]}, {dim}D, {len(rows)} seed{'s' * (len(rows) > 1)} measured now"
        for name in NAMES:
            check(name, WORST[name](row[name] for row in rows), f"{model}_{dim}d", words)


def tables(results: Results) -> list[Table]:
    """The worst of all drops of a model at the map's base."""
    if "map" not in results:
        return []
    rows: list[list[Any]] = []
    for entry in results["map"].values["settings"]:
        if at_base(entry):
            cells = [None if math.isnan(real(entry[n])) else f"{real(entry[n]):.2g}" for n in NAMES]
            stopped = ", ".join(f"{count} {reason}" for reason, count in entry["stopped"].items())
            rows.append([MODELS[entry["model"]][0], f"{entry['dim']}D", entry["drops"], *cells, stopped])
    heading = ["model", "", "drops", "rms speed", "Ca", "momentum", "angular", "nearest, 5 %", "roughness", "stopped"]
    note = (
        "The worst drop of each. Speed over sqrt(sigma/(rho R)) and Ca = mu max|v|/sigma of the nominal tension, at an"
        " Ohnesorge number of 0.03; momenta over the sums of moduli; nearest neighbour in spacings."
    )
    return [Table("Drops at rest", heading, rows, note)] if rows else []


EXPERIMENT = Experiment(
    name="spurious",
    title="drops at rest, every model: spurious speed, momentum, clustering",
    runs=planned,
    checks=checks,
    pictures=(Picture("spurious", pictures.data, pictures.picture, ("map",)),),
    tables=tables,
)
