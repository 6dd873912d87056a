"""Collapse of a liquid column: surface detection against the exact truth, its cost, the surge front.

The column is L wide and 2 L high; walls are free slip; Tait equation of state. The paper does not say what its dam
break looks like (E17b): the settings of `runs.py` are this project's, and stand in every result.
"""

from __future__ import annotations

from typing import Any

from validation.cases.dam_break import pictures, runs
from validation.harness import Case, Options, Picture, Results, Run
from validation.metrics.dam_break import FRONT_DATA, data_tolerance
from validation.results import real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

COSTLY = (2048, 3200, 7200, 12800, 20000)  # particles of figure 5; 2 n^2 each
COSTLY_QUICK = (800, 1800, 3200)


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    quick, backend = options.quick, options.backend
    made = [
        Run("detection_2d", runs.collapse, {"columns": 40, "until": 1.8, "backend": backend}, estimate=18.0),
        Run("front_2d", runs.surge, {"columns": 28 if quick else 40, "backend": backend}, estimate=7 if quick else 12),
        Run(
            "detection_cost",
            runs.detection_cost,
            {
                "columns": [round((n / 2) ** 0.5) for n in (COSTLY_QUICK if quick else COSTLY)],
                "repeats": 15,
                "backend": backend,
            },
            estimate=8.0 if quick else 90.0,
        ),
    ]
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
            {"columns": 20, "depth": 20, "until": 1.2, "samples": 8, "backend": backend},
            estimate=150.0,
            skip=reason,
        ),
    ]
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
        gain = "f1_gain" if key == "detection_2d" else "f1_gain_3d"
        made.append(bounds.judge(gain, f1["two_step"] - f1["number_density"], key, words))
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
    if "detection_cost" in results:
        last = results["detection_cost"].values["sizes"][-1]
        run, words = str(last["particles"]), f"{last['particles']:,} particles"
        for method in ("number_density", "two_step", "fan_scan"):
            seconds = last["methods"][method]
            made.append(
                bounds.judge(
                    "detection_time", 1e3 * seconds["whole"], f"{method}.{run}", f"{runs.WORDS[method]}, {words}"
                )
            )
        scan = {m: last["methods"][m]["scan"] for m in ("two_step", "fan_scan")}
        made.append(bounds.judge("scan_ratio", scan["two_step"] / scan["fan_scan"], run, words))
    return made


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
    if "detection_cost" in results:
        rows = []
        for size in results["detection_cost"].values["sizes"]:
            methods = size["methods"]
            row = [size["particles"], f"{100 * size['scanned_share']:.1f} %"]
            row += [f"{1e3 * methods[m]['whole']:.3f}" for m in ("number_density", "two_step", "fan_scan")]
            row += [f"{1e3 * methods[m]['scan']:.3f}" for m in ("two_step", "fan_scan")]
            row += [f"{1e3 * size['number_density_pass']:.3f}"]
            rows.append(row)
        made.append(
            Table(
                "Detection time [ms], medians",
                [
                    "particles",
                    "scanned",
                    "density",
                    "two-step",
                    "fan scan",
                    "scan of two-step",
                    "scan of all",
                    "J(8) alone",
                ],
                rows,
                "Whole detection counts threshold, normals and scan. J(8), the number density, comes with the density"
                " pass of every step and is charged to none.",
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


CASE = Case(
    name="dam_break",
    title="collapse of a liquid column: surface detection (figures 4 and 5) and the surge front",
    runs=planned,
    judge=judge,
    pictures=(
        Picture("figure_4", pictures.detection_data, pictures.detection_picture, ("detection_2d",)),
        Picture("figure_4_scores", pictures.score_data, pictures.score_picture, ("detection_2d",)),
        Picture("figure_5", pictures.cost_data, pictures.cost_picture, ("detection_cost",)),
        Picture("front", pictures.front_data, pictures.front_picture, ("front_2d",)),
    ),
    tables=tables,
)
