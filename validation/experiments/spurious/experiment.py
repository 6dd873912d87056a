"""Drops at rest: spurious speed, momentum, clustering."""

from __future__ import annotations

import itertools
from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.spurious import pictures
from validation.measure.drops import MODELS
from validation.measure.sigma_map import WORST, drop_run, map_run

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


EXPERIMENT = Experiment(
    name="spurious",
    title="drops at rest, every model: spurious speed, momentum, clustering",
    runs=planned,
    checks=checks,
    pictures=(Picture("spurious", pictures.data, pictures.picture, ("map",)),),
)
