"""Which model of surface tension for which accuracy: errors of drops against the seconds that they take.

The errors are those of the drops on file. The seconds are their steps times the seconds of a step, which
`validation/measure/drop_seconds.py` measures apart, for all drops on one machine.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refsim import InputError, calibrate
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.tension_cost import pictures
from validation.experiments.tension_cost.pictures import words_of
from validation.measure import drop_seconds
from validation.measure.drops import MODELS, base, in_panel
from validation.measure.sigma_map import WORST_MISFIT, map_run
from validation.results import Result, real
from validation.running import Context
from validation.work_precision import pareto

BARS = (0.25, 0.1, 0.05, 0.025)  # errors that a user may accept
HOW = ("kernels", "dtype", "backend")


def planned(options: Options) -> list[Run]:
    """The drops and the seconds of a step on file; nothing is measured."""
    digest = hashlib.sha256(drop_seconds.FILE.read_bytes()).hexdigest()[:16] if drop_seconds.FILE.exists() else ""
    return [map_run(), Run("seconds", seconds_on_file, {"file": digest}, estimate=1.0)]


def seconds_on_file(context: Context, file: str) -> Result:
    """The seconds of a step; `file` is the digest of where they stand."""
    return Result(drop_seconds.read())


def by_key(timings: Mapping[str, Any]) -> dict[str, float]:
    """Seconds of a step of each drop, by its key."""
    return {row["key"]: row["seconds_per_step"] for kind in timings.values() for row in kind["rows"]}


def promised(model: str, kernels: str, rows: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """Tension over the nominal one that `calibrate` promises, and its relative uncertainty.

    Where it refuses, the mean of the largest drop, whose uncertainty is not known.
    """
    try:
        where = base(model) | {"kernels": kernels}
        lengths = {"spacing": 1.0, "rest_density": 1.0, "support_radius": where["support"]}
        found = calibrate(1.0, model, kernels=where["kernels"], **lengths)
        return found.ratio, found.uncertainty
    except InputError:
        swinging = [r for r in rows if _swings(r)]
        if not swinging:
            return math.nan, math.inf
        largest = max(swinging, key=lambda r: r["radius"])
        return 0.5 * (largest["laplace"] + largest["rayleigh"]), math.inf


def _swings(row: Mapping[str, Any]) -> bool:
    return not row["stopped"] and real(row.get("misfit")) <= WORST_MISFIT and row["laplace"] > 0


def points(rows: Sequence[Mapping[str, Any]], timings: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One point for each model, radius, dtype and backend in 3D at the base setting: errors and seconds.

    sigma      |tension by the jump over the promised one - 1|, rms over the seeds
    frequency  the same of the frequency of the mode n = 2
    roughness  of the outer surface at rest
    unsure     relative uncertainty of the promised tension
    seconds    on one thread or a GPU, relaxing, watching and swinging: steps (mean of the seeds) times seconds a step;
               NaN where no step was timed
    """
    own = [r for r in rows if in_panel(r)]
    groups: dict[tuple[Any, ...], list[Mapping[str, Any]]] = {}
    step = by_key(timings)
    for row in own:
        groups.setdefault((row["model"], *(row[name] for name in HOW), row["radius"]), []).append(row)
    made = []
    for (model, kernels, dtype, backend, radius), drops in sorted(groups.items()):
        lasting = [r for r in drops if not r["stopped"]]
        reference, unsure = promised(model, kernels, [r for r in own if (r["model"], r["kernels"]) == (model, kernels)])
        point = {"model": model, "kernels": kernels, "dtype": dtype, "backend": backend, "radius": radius}
        if len(lasting) < len(drops) or not math.isfinite(reference):
            stopped = next((r["stopped"] for r in drops if r["stopped"]), "no tension")
            made.append({**point, "stopped": stopped})
            continue
        seconds_a_step = next((step[r["key"]] for r in lasting if r["key"] in step), math.nan)
        jump = [r["laplace"] / reference - 1 for r in lasting]
        waves = [math.sqrt(r["rayleigh"] / reference) - 1 if _swings(r) else math.nan for r in lasting]
        made.append(
            {
                **point,
                "stopped": "",
                "unsure": unsure,
                "particles": lasting[0]["particles"],
                "sigma": float(np.sqrt(np.mean(np.square(jump)))),
                "frequency": float(np.sqrt(np.mean(np.square(waves)))),
                "roughness": float(np.mean([real(r["roughness"]) for r in lasting])),
                "seconds": float(np.mean([r["steps"] for r in lasting])) * seconds_a_step,
                "seeds": len(lasting),
            }
        )
    return made


def worse(point: Mapping[str, Any]) -> float:
    """The larger of tension's and frequency's error; infinite where one is not known."""
    both = (real(point.get("sigma")), real(point.get("frequency")))
    return max(both) if all(map(math.isfinite, both)) else math.inf


def advice(made: Sequence[Mapping[str, Any]]) -> list[tuple[float, Mapping[str, Any] | None]]:
    """For each bar the cheapest point whose tension and frequency are within it, as those of all larger drops of it.

    Of models whose tension `calibrate` knows that well: what only happens to pass the middle is no advice.
    """

    def lasts(point: Mapping[str, Any], bar: float) -> bool:
        same = [p for p in made if all(p[n] == point[n] for n in ("model", *HOW)) and p["radius"] >= point["radius"]]
        return real(point["unsure"]) <= bar and all(worse(p) <= bar for p in same)

    found = []
    for bar in BARS:
        good = [p for p in timed(made) if p["backend"] == "cpu" and lasts(p, bar)]
        found.append((bar, min(good, key=lambda p: p["seconds"]) if good else None))
    return found


def timed(made: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The points of drops that lasted and whose steps were timed."""
    return [p for p in made if not p["stopped"] and math.isfinite(real(p["seconds"]))]


def of(results: Results) -> list[dict[str, Any]]:
    """The points of the files."""
    return points(results["map"].values["rows"], results["seconds"].values)


def checks(results: Results, check: Checks) -> None:
    """Shown, and judged where the target stands: what the best model keeps from 10 spacings on."""
    if not {"map", "seconds"} <= results.keys():
        return
    made = of(results)
    for point in made:
        if not point["stopped"] and point["radius"] == 10.0:
            name = "_".join((point["model"], *(point[n] for n in HOW)))
            words = f"{words_of(point)}, {point['dtype']}, {point['backend']}, R = 10 d"
            for quantity in ("sigma", "frequency", "roughness"):
                check(quantity, point[quantity], name, words)
    for model in MODELS:
        pair = {p["dtype"]: p for p in made if p["model"] == model and p["radius"] == 10 and p["backend"] == "cpu"
                and p["kernels"] == base(model)["kernels"]}  # fmt: skip
        if {"float32", "float64"} <= pair.keys() and len(timed(list(pair.values()))) == 2:
            share = pair["float64"]["seconds"] / pair["float32"]["seconds"]
            check("float64", share, model, MODELS[model][0])


def machines(timings: Mapping[str, Any]) -> str:
    """Where the seconds were measured."""
    words = {"cpu": "one thread of", "cuda": "one"}
    return "; ".join(f"{words[kind]} {timings[kind]['machine']}, {timings[kind]['date']}" for kind in sorted(timings))


def data(results: Results) -> dict[str, Any]:
    """What the picture shows."""
    made = of(results)
    alive = [p for p in timed(made) if math.isfinite(worse(p))]
    front = [alive[k] for k in pareto([{"error": worse(p), "seconds": p["seconds"]} for p in alive])]
    return {
        "title": "Which model for which accuracy: drops of 4 to 14 spacings in radius, 3D",
        "machines": machines(results["seconds"].values),
        "points": made,
        "front": [{n: p[n] for n in ("model", "radius", *HOW)} for p in front],
        "advice": [{"bar": bar, "point": p} for bar, p in advice(made)],
    }


EXPERIMENT = Experiment(
    name="tension_cost",
    title="what accuracy costs: tension, frequency and roughness of drops against seconds, every model",
    runs=planned,
    checks=checks,
    pictures=(Picture("tension_cost", data, pictures.picture, ("map", "seconds")),),
)
