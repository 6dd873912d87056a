"""Collapse of a liquid column: surface detection against the exact truth, its cost, the surge front.

The column is L wide and 2 L high; walls are free slip; Tait equation of state. The paper does not say what its dam
break looks like (Jiang & Zhu E17b): the settings of `runs.py` are this project's, and stand in every result.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.dam_break import claims, pictures, runs, stability
from validation.experiments.dam_break.claims import COSTLY_QUICK, costs_planned
from validation.metrics.dam_break import FRONT_DATA
from validation.results import floats, real

FIGURE_FROM = 2000  # particles from which on figure 5 is judged; below, launches take a part of the time
FIGURE_5 = tuple(f"detection_cost_{k + 1}" for k in range(len(COSTLY_QUICK)))  # it takes more where there are more
MOMENTS = (0.3, 0.6, 1.0)  # s: at which the recall of two steps is held against that of the fan scan alone


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend = options.quick, options.backend
    columns, estimate = (28, 7.0) if quick else (40, 15.0)
    made = [
        Run("detection_2d", runs.collapse, {"columns": columns, "until": 1.8, "backend": backend}, estimate),
        Run("front_2d", runs.surge, {"columns": columns, "backend": backend}, estimate),
    ]
    made += costs_planned(options)
    reason = "in 3D it takes minutes; run without --quick" if quick else ""
    made += [
        Run(
            "front_3d",
            runs.surge,
            {"columns": 20, "depth": 6, "backend": backend},
            estimate=60.0,
            skip=reason,
        ),
        Run(
            "detection_3d",
            runs.collapse,
            {"columns": 20, "depth": 20, "until": 1.2, "samples": 12, "backend": backend},
            estimate=160.0,
            skip=reason,
        ),
    ]
    return made


def checks(results: Results, check: Checks) -> None:
    """The verdicts."""
    for key, words in (("detection_2d", "2D"), ("detection_3d", "3D")):
        if key not in results:
            continue
        values = results[key].values
        for method, score in values["score"].items():
            for name in ("precision", "recall", "f1"):
                check(name, score[name], f"{key}.{method}", f"{runs.WORDS[method]}, {words}")
        f1 = {method: real(score["f1"]) for method, score in values["score"].items()}
        check("f1_gain", f1["two_step"] - f1["number_density"], key, words)
        for method, name in (("two_step", "recall_gap"), ("two_step_printed", "recall_gap_printed")):
            for moment in MOMENTS:
                k = int(np.argmin(np.abs(floats(values["time"]) - moment)))
                gap = recall_gap(values["over_time"], method, k)
                check(name, gap, f"{key}.{moment}", f"{words}, {moment} s")
            pooled = {m: values["score"][m]["recall"] for m in (method, "fan_scan")}
            check(name, pooled[method] - pooled["fan_scan"], key, f"{words}, whole collapse")
        check("scanned_share", values["scanned_share"], key, words)
    for key, words in (("front_2d", "2D"), ("front_3d", "3D")):
        if key in results:
            for name, fit in results[key].values["front"].items():
                label = f"{words}, {LABELS[name]}"
                kind = "front" if FRONT_DATA[name].kind == "experiment" else "front_computed"
                check(kind, abs(real(fit["largest"])), f"{key}.{name}", label)
                check("time_offset", fit["offset"], f"{key}.{name}", label)
    for key, result in results.items():
        if "ledger" in result.values:
            ledger = result.values["ledger"]
            words = key.replace("_", " ")
            for name in ("lost_particles", "mass_change", "energy_rise", "missed_neighbours"):
                check(name, ledger[name], key, words)
    for size in sizes(results):
        run, words, methods = str(size["particles"]), f"{size['particles']:,} particles", size["methods"]
        for method in ("number_density", "two_step", "fan_scan"):
            seconds = 1e3 * methods[method]["whole"]
            check("detection_seconds", seconds, f"{method}.{run}", f"{runs.WORDS[method]}, {words}")
        judged = "detection_ratio" if size["particles"] >= FIGURE_FROM else "detection_ratio_small"
        for name, part in (
            (judged, "whole"),
            ("detection_ratio_charged", "charged"),
            ("scan_ratio", "scan"),
        ):
            ratio = methods["two_step"][part] / methods["fan_scan"][part]
            check(name, ratio, run, words)
        together = size["all_threads"]
        ratio = together["two_step"]["whole"] / together["fan_scan"]["whole"]
        check("detection_ratio_threads", ratio, run, words)


def sizes(results: Results) -> list[Mapping[str, Any]]:
    """What detection costs, by growing number of particles."""
    found = [result.values for key, result in results.items() if key.startswith("detection_cost_")]
    return sorted(found, key=lambda values: values["particles"])


def recall_gap(over_time: Mapping[str, Any], method: str, k: int) -> float:
    """Recall of a detector less that of the fan scan alone at sample k."""
    return real(over_time[method]["recall"][k]) - real(over_time["fan_scan"]["recall"][k])


LABELS = {
    "martin_moyce_1.125in": "Martin & Moyce 1952, 1.125 in",
    "martin_moyce_2.25in": "Martin & Moyce 1952, 2.25 in",
    "koshizuka_oka": "Koshizuka & Oka 1996",
    "koshizuka_oka_mps": "Koshizuka & Oka 1996, MPS",
}


EXPERIMENT = Experiment(
    name="dam_break",
    title="collapse of a liquid column: surface detection (figures 4 and 5) and the surge front",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("figure_4", pictures.detection_data, pictures.detection_picture, ("detection_2d",)),
        Picture("figure_4_scores", pictures.score_data, pictures.score_picture, ("detection_2d",)),
        Picture("figure_5", pictures.cost_data, pictures.cost_picture, FIGURE_5),
        Picture("front", pictures.front_data, pictures.front_picture, ("front_2d",)),
        Picture("voids", pictures.void_data, pictures.void_picture, ("voids",)),
    ),
    claims=measures(claims),
    trials=vars(stability),
)
