"""Which model of surface tension for which accuracy: errors of drops against the seconds that they take."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refsim import InputError, calibrate
from validation.cases.tension_cost import pictures
from validation.drops import MODELS, base
from validation.harness import Case, Options, Picture, Results, Run
from validation.results import real
from validation.sigma_map import WORST_MISFIT, map_run
from validation.tables import Table
from validation.verdicts import Bounds, Measurement
from validation.work_precision import pareto

BARS = (0.25, 0.1, 0.05, 0.025)  # errors that a user may ask for
HOW = ("dtype", "backend")


def planned(options: Options) -> list[Run]:
    """The drops on file; nothing is measured."""
    return [map_run()]


def promised(model: str, rows: Sequence[Mapping[str, Any]]) -> float:
    """Tension over the nominal one that `calibrate` promises; where it refuses, the mean of the largest drop."""
    try:
        where = base(model)
        lengths = {"spacing": 1.0, "rest_density": 1.0, "support_radius": where["support"]}
        return calibrate(1.0, model, kernels=where["kernels"], **lengths).ratio
    except InputError:
        swinging = [r for r in rows if _swings(r)]
        if not swinging:
            return math.nan
        largest = max(swinging, key=lambda r: r["radius"])
        return 0.5 * (largest["laplace"] + largest["rayleigh"])


def _swings(row: Mapping[str, Any]) -> bool:
    return not row["stopped"] and real(row.get("misfit")) <= WORST_MISFIT and row["laplace"] > 0


def points(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """One point for each model, radius, dtype and backend in 3D at the base setting: errors and seconds.

    sigma      |tension by the jump over the promised one - 1|, rms over the seeds
    frequency  the same of the frequency of the mode n = 2
    roughness  of the outer surface at rest
    seconds    on one thread, relaxing, watching and swinging; the least of the seeds
    """
    own = [r for r in rows if r["dim"] == 3 and all(r[n] == v for n, v in base(r["model"]).items())]
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    for row in own:
        how = tuple(row.get(name, default) for name, default in zip(HOW, ("float32", "cpu")))
        groups.setdefault((row["model"], *how, row["radius"]), []).append(row)
    made = []
    for (model, dtype, backend, radius), drops in sorted(groups.items()):
        lasting = [r for r in drops if not r["stopped"]]
        reference = promised(model, [r for r in own if r["model"] == model])
        point = {"model": model, "dtype": dtype, "backend": backend, "radius": radius}
        if len(lasting) < len(drops) or not math.isfinite(reference):
            stopped = next((r["stopped"] for r in drops if r["stopped"]), "no tension")
            made.append({**point, "stopped": stopped})
            continue
        jump = [r["laplace"] / reference - 1 for r in lasting]
        waves = [math.sqrt(r["rayleigh"] / reference) - 1 if _swings(r) else math.nan for r in lasting]
        made.append(
            {
                **point,
                "stopped": "",
                "particles": lasting[0]["particles"],
                "sigma": float(np.sqrt(np.mean(np.square(jump)))),
                "frequency": float(np.sqrt(np.mean(np.square(waves)))),
                "roughness": float(np.mean([r["roughness"] for r in lasting])),
                "seconds": float(min(r["seconds"] for r in lasting)),
                "seeds": len(lasting),
            }
        )
    return made


def worse(point: Mapping[str, Any]) -> float:
    """The larger of tension's and frequency's error; infinite where one is not known."""
    both = (real(point.get("sigma")), real(point.get("frequency")))
    return max(both) if all(map(math.isfinite, both)) else math.inf


def advice(made: Sequence[Mapping[str, Any]]) -> list[tuple[float, Mapping[str, Any] | None]]:
    """For each bar the cheapest point whose tension and frequency are within it, as those of all larger drops of it."""

    def lasts(point: Mapping[str, Any], bar: float) -> bool:
        same = [p for p in made if all(p[n] == point[n] for n in ("model", *HOW)) and p["radius"] >= point["radius"]]
        return all(worse(p) <= bar for p in same)

    found = []
    for bar in BARS:
        good = [p for p in made if p["backend"] == "cpu" and not p["stopped"] and lasts(p, bar)]
        found.append((bar, min(good, key=lambda p: p["seconds"]) if good else None))
    return found


def judge(results: Results) -> list[Measurement]:
    """Shown, and judged where the target stands: what the best model keeps from 10 spacings on."""
    if "map" not in results:
        return []
    bounds, out = Bounds("tension_cost"), []
    made = points(results["map"].values["rows"])
    for point in made:
        if not point["stopped"] and point["radius"] == 10.0:
            name = f"{point['model']}_{point['dtype']}_{point['backend']}"
            words = f"{MODELS[point['model']][0]}, {point['dtype']}, {point['backend']}, R = 10 d"
            out += [bounds.judge(n, real(point[n]), name, words) for n in ("sigma", "frequency", "roughness")]
    for model in MODELS:
        pair = {p["dtype"]: p for p in made if p["model"] == model and p["radius"] == 10 and p["backend"] == "cpu"}
        if {"float32", "float64"} <= pair.keys() and not any(p["stopped"] for p in pair.values()):
            share = pair["float64"]["seconds"] / pair["float32"]["seconds"]
            out.append(bounds.judge("float64", share, model, MODELS[model][0]))
    return out


def tables(results: Results) -> list[Table]:
    """Every point, and which model to take for which accuracy."""
    if "map" not in results:
        return []
    made = points(results["map"].values["rows"])
    rows: list[list[Any]] = []
    for p in made:
        place = [MODELS[p["model"]][0], f"{p['radius']:g}", p["dtype"], p["backend"]]
        if p["stopped"]:
            rows.append([*place, None, None, None, None, p["stopped"]])
            continue
        shares = [f"{100 * p[n]:.1f} %" if math.isfinite(real(p[n])) else None for n in ("sigma", "frequency")]
        rows.append([*place, *shares, f"{p['roughness']:.4f}", f"{p['seconds']:.1f}", ""])
    heading = ["model", "R/d", "dtype", "backend", "sigma off", "frequency off", "roughness", "seconds", ""]
    note = "Off what calibrate promises, or, where it refuses, off the mean of the largest drop's jump and frequency."
    taken: list[list[Any]] = []
    for bar, p in advice(made):
        which = [MODELS[p["model"]][0], f"{p['radius']:g}", p["dtype"], f"{p['seconds']:.1f}"] if p else ["none"]
        taken.append([f"{100 * bar:g} %", *which, *[None] * (4 - len(which))])
    said = "The cheapest whose tension and frequency are both within the bar, at this size and every larger one."
    return [
        Table("Errors and cost of drops, 3D", heading, rows, note),
        Table("Which model for which accuracy", ["within", "model", "R/d", "dtype", "seconds"], taken, said),
    ]


def data(results: Results) -> dict[str, Any]:
    """What the picture shows."""
    made = points(results["map"].values["rows"])
    alive = [p for p in made if not p["stopped"] and math.isfinite(worse(p))]
    front = [alive[k] for k in pareto([{"error": worse(p), "seconds": p["seconds"]} for p in alive])]
    return {
        "title": "Which model for which accuracy: drops of 5 to 14 spacings in radius, 3D",
        "points": made,
        "front": [{n: p[n] for n in ("model", "radius", *HOW)} for p in front],
        "advice": [{"bar": bar, "point": p} for bar, p in advice(made)],
    }


CASE = Case(
    name="tension_cost",
    title="what accuracy costs: tension, frequency and roughness of drops against seconds, every model",
    runs=planned,
    judge=judge,
    pictures=(Picture("tension_cost", data, pictures.picture, ("map",)),),
    tables=tables,
)
