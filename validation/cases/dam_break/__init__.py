"""Collapse of a liquid column: surface detection against the exact truth, its cost, the surge front.

The column is L wide and 2 L high; walls are free slip; Tait equation of state. The paper does not say what its dam
break looks like (E17b): the settings of `runs.py` are this project's, and stand in every result.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from refsim.backends.arrays import unavailable
from validation.cases.dam_break import pictures, runs
from validation.harness import Case, Options, Picture, Results, Run
from validation.metrics.dam_break import FRONT_DATA, data_tolerance
from validation.results import floats, real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

COSTLY = (32, 50, 80, 126, 200, 316)  # columns of figure 5: 2,048 to 199,712 particles, 2 n^2 each
COSTLY_QUICK = (20, 30, 50)  # at 5,000 particles two steps lead by more than the noise of a busy machine
FIGURE_FROM = 2000  # particles from which on figure 5 is judged; below, launches take a part of the time
FIGURE_5 = tuple(f"detection_cost_{k + 1}" for k in range(len(COSTLY_QUICK)))  # it takes more where there are more
MOMENTS = (0.3, 0.6, 1.0)  # s: at which the recall of two steps is held against that of the fan scan alone


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend = options.quick, options.backend
    made = [
        Run("detection_2d", runs.collapse, {"columns": 40, "until": 1.8, "backend": backend}, estimate=18.0),
        Run("front_2d", runs.surge, {"columns": 28 if quick else 40, "backend": backend}, estimate=7 if quick else 12),
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


def costs_planned(options: Options) -> list[Run]:
    """Figure 5, a run for each size; a GPU, where there is one, moves the column to the state that is timed."""
    made = []
    for k, columns in enumerate(COSTLY_QUICK if options.quick else COSTLY):
        parameters = {"columns": columns, "repeats": 15, "backend": options.backend}
        if not options.quick and unavailable("cuda") is None:
            parameters["moved_on"] = "cuda"
        made.append(Run(f"detection_cost_{k + 1}", runs.detection_cost, parameters, estimate=1 + 6e-5 * columns**3))
    return made


def judge(results: Results) -> list[Measurement]:
    """The verdicts."""
    bounds, made = Bounds("dam_break"), []
    for key, words in (("detection_2d", "2D"), ("detection_3d", "3D")):
        if key not in results:
            continue
        values = results[key].values
        for method, score in values["score"].items():
            for name in ("precision", "recall", "f1"):
                made.append(bounds.judge(name, real(score[name]), f"{key}.{method}", f"{runs.WORDS[method]}, {words}"))
        f1 = {method: real(score["f1"]) for method, score in values["score"].items()}
        made.append(bounds.judge("f1_gain", f1["two_step"] - f1["number_density"], key, words))
        for method, name in (("two_step", "recall_gap"), ("two_step_printed", "recall_gap_printed")):
            for moment in MOMENTS:
                k = int(np.argmin(np.abs(floats(values["time"]) - moment)))
                gap = recall_gap(values["over_time"], method, k)
                made.append(bounds.judge(name, gap, f"{key}.{moment}", f"{words}, {moment} s"))
            pooled = {m: values["score"][m]["recall"] for m in (method, "fan_scan")}
            made.append(bounds.judge(name, pooled[method] - pooled["fan_scan"], key, f"{words}, whole collapse"))
        made.append(bounds.judge("scanned_share", real(values["scanned_share"]), key, words))
    for key, words in (("front_2d", "2D"), ("front_3d", "3D")):
        if key in results:
            for name, fit in results[key].values["front"].items():
                label = f"{words}, {LABELS[name]}"
                kind = "front" if FRONT_DATA[name].kind == "experiment" else "front_computed"
                made.append(bounds.judge(kind, abs(real(fit["largest"])), f"{key}.{name}", label))
                made.append(bounds.judge("time_offset", real(fit["offset"]), f"{key}.{name}", label))
    for key, result in results.items():
        if "ledger" in result.values:
            ledger = result.values["ledger"]
            words = key.replace("_", " ")
            for name in ("lost_particles", "mass_change", "energy_rise", "missed_neighbours"):
                made.append(bounds.judge(name, real(ledger[name]), key, words))
    for size in sizes(results):
        run, words, methods = str(size["particles"]), f"{size['particles']:,} particles", size["methods"]
        for method in ("number_density", "two_step", "fan_scan"):
            seconds = 1e3 * methods[method]["whole"]
            made.append(bounds.judge("detection_time", seconds, f"{method}.{run}", f"{runs.WORDS[method]}, {words}"))
        judged = "detection_ratio" if size["particles"] >= FIGURE_FROM else "detection_ratio_small"
        for name, part in (
            (judged, "whole"),
            ("detection_ratio_charged", "charged"),
            ("scan_ratio", "scan"),
        ):
            ratio = methods["two_step"][part] / methods["fan_scan"][part]
            made.append(bounds.judge(name, ratio, run, words))
        together = size["all_threads"]
        ratio = together["two_step"]["whole"] / together["fan_scan"]["whole"]
        made.append(bounds.judge("detection_ratio_threads", ratio, run, words))
    return made


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


def tables(results: Results) -> list[Table]:
    """Detection over time, and what detection costs."""
    made = []
    if "detection_2d" in results:
        values = results["detection_2d"].values
        rows = []
        for k in range(0, len(values["time"]), 3):
            row: list[Any] = [f"{values['time'][k]:.2f}", values["truth"][k]]
            for method in runs.METHODS:
                row += [f"{values['over_time'][method][name][k]:.3f}" for name in ("precision", "recall")]
            rows.append(row)
        heading = ["t [s]", "surface"]
        heading += [f"{short} {letter}" for short in ("density", "scan", "two-step") for letter in ("P", "R")]
        made.append(
            Table(
                "Surface detection over the 2D collapse: precision P and recall R of the number density, the fan scan"
                " and the two-step detector",
                heading,
                rows,
                f"Truth: exact arc cover, radius {values['truth_radius']:g} spacings.",
            )
        )
    for key in ("detection_2d", "detection_3d"):
        if key in results:
            made.append(first_steps(key[-2:].upper(), results[key].values["first_step"]))
    costs = sizes(results)
    if costs:
        rows = []
        for size in costs:
            methods = size["methods"]
            row = [size["particles"], f"{100 * size['scanned_share']:.1f} %"]
            row += [f"{1e3 * methods[m]['whole']:.3f}" for m in ("number_density", "two_step", "fan_scan")]
            row += [f"{methods['two_step']['whole'] / methods['fan_scan']['whole']:.2f}"]
            row += [f"{1e3 * methods['two_step'][part]:.3f}" for part in ("moment_sum", "normals", "scan")]
            row += [f"{1e3 * size['number_density_pass']:.3f}"]
            row += [f"{methods['two_step']['charged'] / methods['fan_scan']['whole']:.2f}"]
            together = size["all_threads"]
            row += [f"{together['two_step']['whole'] / together['fan_scan']['whole']:.2f}"]
            rows.append(row)
        made.append(
            Table(
                "Detection time [ms] on one thread, medians",
                [
                    "particles",
                    "scanned",
                    "density",
                    "two-step",
                    "fan scan",
                    "ratio",
                    "first moment",
                    "normals",
                    "scan",
                    "J(8)",
                    "ratio with J(8)",
                    "ratio, all threads",
                ],
                rows,
                "Whole detection: threshold, normals and scan, in two steps also what the first moment adds to the"
                " density pass; these parts are those of two steps. J(8), the number density, comes with the density"
                " pass of every step and is charged to none, and where it says so to two steps, in full.",
            )
        )
    if "front_2d" in results:
        rows = []
        for key in ("front_2d", "front_3d"):
            if key in results:
                for name, fit in results[key].values["front"].items():
                    rows.append(
                        [key[-2:].upper(), LABELS[name], f"{fit['offset']:+.3f}", f"{100 * fit['largest']:+.1f} %",
                         f"{100 * fit['rms']:.1f} %", fit["points"]]
                    )  # fmt: skip
        made.append(
            Table(
                "Surge front against published series, after one fitted time offset each",
                ["run", "series", "offset of t sqrt(2g/L)", "largest deviation", "rms", "points"],
                rows,
                f"The experiments deviate from each other by up to {100 * data_tolerance():.1f} %.",
            )
        )
    return made


def first_steps(words: str, found: Mapping[str, Mapping[str, float]]) -> Table:
    """The rules tried as the first of two steps."""
    rows = [
        [
            runs.FIRST_STEPS[name][0],
            runs.FIRST_STEPS[name][1],
            *(f"{100 * values[part]:.1f}" for part in ("largest_loss", "mean_loss")),
            f"{values['precision']:.3f}",
            *(f"{100 * values[part]:.0f} %" for part in ("share", "largest_share")),
        ]
        for name, values in found.items()
    ]
    heading = ["scanned if", "cost beside J(8)", "largest loss", "mean loss", "precision", "scanned", "at most"]
    note = "Loss: points of recall that the fan scan alone has and two steps have not, at the samples of the collapse."
    return Table(f"First steps tried in the {words} collapse", heading, rows, note)


CASE = Case(
    name="dam_break",
    title="collapse of a liquid column: surface detection (figures 4 and 5) and the surge front",
    runs=planned,
    judge=judge,
    pictures=(
        Picture("figure_4", pictures.detection_data, pictures.detection_picture, ("detection_2d",)),
        Picture("figure_4_scores", pictures.score_data, pictures.score_picture, ("detection_2d",)),
        Picture("figure_5", pictures.cost_data, pictures.cost_picture, FIGURE_5),
        Picture("front", pictures.front_data, pictures.front_picture, ("front_2d",)),
    ),
    tables=tables,
)
