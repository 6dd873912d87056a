"""Drops at rest: spurious speed, momentum, clustering."""

from __future__ import annotations

import math
from typing import Any

from validation.cases.spurious import pictures
from validation.drops import MODELS
from validation.harness import Case, Options, Picture, Results, Run
from validation.results import real
from validation.sigma_map import at_base, drop_run, map_run
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

NAMES = ("spurious", "capillary", "momentum", "angular_momentum", "nn_5", "roughness")
MEASURED = ("akinci", "jiang_zhu", "dong")


def planned(options: Options) -> list[Run]:
    """The published map, and drops of three models in 2D measured now, one with --quick."""
    return [map_run(), *(drop_run(model, 2, 8.0) for model in (MEASURED[:1] if options.quick else MEASURED))]


def judge(results: Results) -> list[Measurement]:
    """Linear momentum is judged where the model keeps it; the rest is shown."""
    bounds, made = Bounds("spurious"), []
    for key, result in results.items():
        row = result.values
        if key == "map" or row["stopped"]:
            continue
        words = f"{MODELS[row['model']][0]}, {row['dim']}D, measured now"
        made += [bounds.judge(name, real(row[name]), key, words) for name in NAMES]
    return made


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


CASE = Case(
    name="spurious",
    title="drops at rest, every model: spurious speed, momentum, clustering",
    runs=planned,
    judge=judge,
    pictures=(Picture("spurious", pictures.data, pictures.picture, ("map",)),),
    tables=tables,
)
