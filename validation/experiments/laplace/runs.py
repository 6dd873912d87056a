"""Young & Laplace: the pressure jump of drops at rest against their curvature, for every model of surface tension."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refsim import InputError, calibrate, calibrate_contact_angle
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.measure import drop_seconds
from validation.measure.drops import MODELS, SEEDED, base, fit_laplace, in_panel
from validation.measure.sigma_map import WORST, WORST_MISFIT, at_base, digest_of, drop_run, map_run, read_rows, words_of
from validation.measure.wetting import ROWS, SIZE, Point, condensed, measure
from validation.results import Result, real
from validation.running import Context
from validation.work_precision import pareto

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


def measured_now(results: Results, dim: int | None = None) -> list[Mapping[str, Any]]:
    """Rows of the drops that were measured now, of one dimension or of both."""
    return [r.values for key, r in results.items() if key != "map" and dim in (None, r.values["dim"])]


def settings(results: Results, dim: int | None = None) -> list[dict[str, Any]]:
    """The map's entries; of one dimension those at the base."""
    found = results["map"].values["settings"] if "map" in results else []
    return [entry for entry in found if dim is None or (entry["dim"] == dim and at_base(entry))]


def spread_of(values: Sequence[float]) -> float:
    """Standard deviation over the mean."""
    return float(np.std(values, ddof=1) / np.mean(values))


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
            check("seed_spread", spread_of(seeded), name, f"{words}, {len(seeded)} seeds")
        check("fit_error", error / slope if slope else math.nan, name, words)
        largest = max(row["radius"] for row in rows if not row["stopped"])
        check("left_over", abs(intercept) * largest / ((dim - 1) * slope), name, words)
    for entry in settings(results):
        if at_base(entry) and math.isfinite(real(entry["laplace"])):
            check("sigma", entry["laplace"], f"map_{entry['model']}_{entry['dim']}d", words_of(entry))
    for entry in settings(results, 3):
        slope, model = real(entry["laplace"]), MODELS[entry["model"]][0]
        error = real(entry["laplace_error"]) / slope if slope > 0 else math.nan
        check("agreement", apart_by(entry), entry["model"], f"{model}, fit +- {100 * error:.0f} %")
    for entry in settings(results, 3):
        for drop in entry["drops_by_radius"]:
            if drop["radius"] >= LARGE:
                words, name = (f"R = {drop['radius']:g} d", f"{entry['model']}_R{drop['radius']:g}")
                check("agreement_drops", apart_by(drop), name, f"{MODELS[entry['model']][0]}, {words}")
    known = {}
    for entry in settings(results):
        if entry["dim"] == 3 and math.isfinite(value := farthest_apart(entry)):
            place = f"h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}"
            known[f"{MODELS[entry['model']][0]}, {place}"] = value
    if known:
        best = min(known, key=lambda name: known[name])
        check("best_agreement", known[best], "", best)


def farthest_apart(entry: Mapping[str, Any]) -> float:
    """Largest |Laplace - Rayleigh| over their mean, of all radii of 10 spacings or more; NaN below three of them."""
    large = [apart_by(drop) for drop in entry["drops_by_radius"] if drop["radius"] >= LARGE]
    return max(large) if len(large) > 2 and all(map(math.isfinite, large)) else math.nan


def apart_by(entry: Mapping[str, Any]) -> float:
    """|Laplace - Rayleigh| over their mean; NaN where one is missing or no tension at all."""
    laplace, rayleigh = real(entry["laplace"]), real(entry["rayleigh"])
    return abs(laplace - rayleigh) / (0.5 * (laplace + rayleigh)) if min(laplace, rayleigh) > 0 else math.nan


EXPERIMENT = Experiment(
    name="laplace", title="pressure jump of drops against 1/R, every model: what the surface tension really is",
    runs=planned, checks=checks,
)  # fmt: skip


# Rayleigh: the frequency of the mode n = 2 of kicked drops, and the tension that it stands for.


OTHERS = (4, 5, 6)  # seeds of drops that calibrate has not seen


def oscillation_planned(options: Options) -> list[Run]:
    """The published map, and drops that are kicked now: with --quick one in 2D; else three there and three in 3D.

    Those in 3D have seeds that the map does not hold, so that they test the tension predicted by `calibrate`.
    """
    if options.quick:
        return [map_run(), drop_run(LEADING, 2, 16.0, kicked=True)]
    flat = [drop_run(LEADING, 2, 16.0, seed, kicked=True) for seed in (1, 2, 3)]
    return [map_run(), *flat, *(drop_run(LEADING, 3, 10.0, seed, kicked=True) for seed in OTHERS)]


def oscillation_checks(results: Results, check: Checks) -> None:
    """How well a damped sine describes the drop is judged; tension and damping are shown."""
    for key, result in results.items():
        if key == "map":
            continue
        row = result.values
        words = f"{MODELS[row['model']][0]}, {row['dim']}D, seed {row['seed']}, measured now"
        for name in ("rayleigh", "misfit"):
            check(name, row.get(name), key, words)
        check("over_laplace", real(row.get("rayleigh")) / real(row["laplace"]), key, words)
        if row["seed"] in OTHERS and not row["stopped"]:
            for name, value in requested(row).items():
                check("requested", value, f"{key}.{name}", f"{name}, seed {row['seed']}")
        check("damping", real(row.get("damping")) / real(row.get("lamb")), key, words)
    for dim in (2, 3):
        found = [real(row.get("rayleigh")) for row in measured_now(results, dim) if not row["stopped"]]
        if len(found) > 1:
            words = f"{MODELS[LEADING][0]}, {dim}D, {len(found)} seeds"
            check("seed_spread", spread_of(found), f"{LEADING}_{dim}d", words)


def requested(row: Mapping[str, Any]) -> dict[str, float]:
    """Relative difference of both tensions of a drop from the one requested of `calibrate`."""
    place = {"dim": row["dim"], "radius": row["radius"], "spacing": 1.0, "rest_density": 1.0}
    ratio = calibrate(1.0, row["model"], **place).ratio  # measured over nominal tension
    return {name.capitalize(): abs(row[name] / ratio - 1) for name in ("laplace", "rayleigh")}


OSCILLATION_EXPERIMENT = Experiment(
    name="oscillation", title="frequency of kicked drops, mode n = 2, every model: tension by Rayleigh",
    runs=oscillation_planned, checks=oscillation_checks,
)  # fmt: skip


# Drops at rest: spurious speed, momentum, clustering.


NAMES = ("spurious", "capillary", "momentum", "angular_momentum", "nn_5", "roughness")
SPURIOUS_MEASURED = ("akinci", "jiang_zhu", "dong")
RADIUS = {2: 8.0, 3: 8.5}


def spurious_planned(options: Options) -> list[Run]:
    """The published map, and drops measured now: three models and three seeds in 2D and 3D, one drop with --quick."""
    if options.quick:
        return [map_run(), drop_run(SPURIOUS_MEASURED[0], 2, RADIUS[2])]
    every = itertools.product(RADIUS.items(), SPURIOUS_MEASURED, (1, 2, 3))
    return [map_run(), *(drop_run(model, dim, radius, seed) for (dim, radius), model, seed in every)]


def spurious_checks(results: Results, check: Checks) -> None:
    """The worst seed of each model: linear momentum, which all of them keep, is judged; the rest is shown."""
    groups: dict[tuple[str, int], list[Any]] = {}
    for row in measured_now(results):
        if not row["stopped"]:
            groups.setdefault((row["model"], row["dim"]), []).append(row)
    for (model, dim), rows in groups.items():
        words = f"{MODELS[model][0]}, {dim}D, {len(rows)} seed{'s' * (len(rows) > 1)} measured now"
        for name in NAMES:
            check(name, WORST[name](row[name] for row in rows), f"{model}_{dim}d", words)


SPURIOUS_EXPERIMENT = Experiment(
    name="spurious", title="drops at rest, every model: spurious speed, momentum, clustering", runs=spurious_planned,
    checks=spurious_checks,
)  # fmt: skip


# Which model of surface tension for which accuracy: errors of drops against the seconds that they take.
#
# The errors are those of the drops on file. The seconds are their steps times the seconds of a step, which
# `validation/measure/drop_seconds.py` measures apart, for all drops on one machine.


BARS = (0.25, 0.1, 0.05, 0.025)  # errors that a user may accept
HOW = ("kernels", "dtype", "backend")


def drop_words(point: Mapping[str, Any]) -> str:
    """The model, and its kernels where they are not those of its base."""
    other = "" if point["kernels"] == base(point["model"])["kernels"] else f", {point['kernels']}"
    return MODELS[point["model"]][0] + other


def cost_planned(options: Options) -> list[Run]:
    """The drops and the seconds of a step on file; nothing is measured."""
    digest = digest_of(drop_seconds.FILE) if drop_seconds.FILE.exists() else ""
    return [map_run(), Run("seconds", seconds_on_file, {"file": digest}, estimate=1.0)]


def seconds_on_file(context: Context, file: str) -> Result:
    """The seconds of a step; `file` is the digest of where they stand."""
    return Result(drop_seconds.read())


def _swings(row: Mapping[str, Any]) -> bool:
    return not row["stopped"] and real(row.get("misfit")) <= WORST_MISFIT and row["laplace"] > 0


def timed(made: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The points of drops that lasted and whose steps were timed."""
    return [p for p in made if not p["stopped"] and math.isfinite(real(p["seconds"]))]


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


def by_key(timings: Mapping[str, Any]) -> dict[str, float]:
    """Seconds of a step of each drop, by its key."""
    return {row["key"]: row["seconds_per_step"] for kind in timings.values() for row in kind["rows"]}


def machines(timings: Mapping[str, Any]) -> str:
    """Where the seconds were measured."""
    words = {"cpu": "one thread of", "cuda": "one"}
    return "; ".join(f"{words[kind]} {timings[kind]['machine']}, {timings[kind]['date']}" for kind in sorted(timings))


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
        made.append({
            **point, "stopped": "", "unsure": unsure, "particles": lasting[0]["particles"],
            "sigma": float(np.sqrt(np.mean(np.square(jump)))), "frequency": float(np.sqrt(np.mean(np.square(waves)))),
            "roughness": float(np.mean([real(r["roughness"]) for r in lasting])),
            "seconds": float(np.mean([r["steps"] for r in lasting])) * seconds_a_step, "seeds": len(lasting),
        })  # fmt: skip
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


def of(results: Results) -> list[dict[str, Any]]:
    """The points of the files."""
    return points(results["map"].values["rows"], results["seconds"].values)


def cost_checks(results: Results, check: Checks) -> None:
    """Shown, and judged where the target stands: what the best model keeps from 10 spacings on."""
    if not {"map", "seconds"} <= results.keys():
        return
    made = of(results)
    for point in made:
        if not point["stopped"] and point["radius"] == 10.0:
            name = "_".join((point["model"], *(point[n] for n in HOW)))
            words = f"{drop_words(point)}, {point['dtype']}, {point['backend']}, R = 10 d"
            for quantity in ("sigma", "frequency", "roughness"):
                check(quantity, point[quantity], name, words)
    for model in MODELS:
        pair = {p["dtype"]: p for p in made if p["model"] == model and p["radius"] == 10 and p["backend"] == "cpu"
                and p["kernels"] == base(model)["kernels"]}  # fmt: skip
        if {"float32", "float64"} <= pair.keys() and len(timed(list(pair.values()))) == 2:
            share = pair["float64"]["seconds"] / pair["float32"]["seconds"]
            check("float64", share, model, MODELS[model][0])


def data(results: Results) -> dict[str, Any]:
    """What the picture shows."""
    made = of(results)
    alive = [p for p in timed(made) if math.isfinite(worse(p))]
    front = [alive[k] for k in pareto([{"error": worse(p), "seconds": p["seconds"]} for p in alive])]
    return {
        "title": "Which model for which accuracy: drops of 4 to 14 spacings in radius, 3D",
        "machines": machines(results["seconds"].values), "points": made,
        "front": [{n: p[n] for n in ("model", "radius", *HOW)} for p in front],
        "advice": [{"bar": bar, "point": p} for bar, p in advice(made)],
    }  # fmt: skip


COST_EXPERIMENT = Experiment(
    name="tension_cost",
    title="what accuracy costs: tension, frequency and roughness of drops against seconds, every model",
    runs=cost_planned,
    checks=cost_checks,
)


# Sessile drops on a plane: the contact angle against the coefficient of adhesion, and the requested angle.


ASKED = {2: (70.0, 110.0), 3: (70.0, 90.0, 115.0)}  # degrees
UNSEEN = 4  # seed that is not in the map


def published(context: Context, rows: str) -> Result:
    """The rows and settings on file; `rows` is the file's digest."""
    found = read_rows(ROWS)
    return Result({"settings": condensed(found), "rows": found})


def asked(context: Context, dim: int, radius: float, angle: float) -> Result:
    """A drop with the adhesion that `calibrate_contact_angle` gives for an angle, of a seed not in the map."""
    found = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=dim)
    row = measure(Point(found.share, dim, radius=radius, seed=UNSEEN))
    return Result({**row, "asked": angle, "uncertainty": found.uncertainty})


def setting_words(entry: Mapping[str, Any]) -> str:
    """A setting in words."""
    return f"{entry['dim']}D, h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}"


def setting_name(entry: Mapping[str, Any]) -> str:
    """A setting as a part of a measurement's name."""
    return f"{entry['dim']}d_{entry['kernels']}_h{entry['support']:g}_S{entry['stiffness']:g}"


def wetting_planned(options: Options) -> list[Run]:
    """The published map, and drops measured now for requested angles: with --quick one in 2D."""
    made = [Run("map", published, {"rows": digest_of(ROWS)}, estimate=1.0)]
    if options.quick:
        return [*made, Run("asked_2d_90", asked, {"dim": 2, "radius": 10.0, "angle": 90.0}, estimate=6.0)]
    for dim, angles in ASKED.items():
        for angle in angles:
            drop = {"dim": dim, "radius": SIZE[dim], "angle": angle}
            made.append(Run(f"asked_{dim}d_{angle:g}", asked, drop, estimate=20.0))
    return made


def wetting_checks(results: Results, check: Checks) -> None:
    """The measured against the requested contact angle, and what the map shows."""
    for key, result in results.items():
        row = result.values
        if key == "map" or row["stopped"]:
            continue
        words = f"{row['dim']}D, {row['asked']:g} degrees requested, measured now"
        check("requested", abs(row["angle"] - row["asked"]), key, words)
        check("two_ways", abs(row["angle"] - real(row["circle"])), key, words)
        check("drift", abs(row["drift"]), key, words)
        check("through", row["through"], key, words)
    for entry in settings(results):
        caps = [drop for drop in entry["drops"] if not math.isnan(real(drop["angle"]))]
        if len(caps) < 4:
            continue
        name, words = setting_name(entry), setting_words(entry)
        angles = np.array([drop["angle"] for drop in caps])
        check("span", float(np.ptp(angles)), name, words)
        share, cosine = np.array([drop["share"] for drop in caps]), np.cos(np.radians(angles))
        rest = cosine - np.polyval(np.polyfit(share, cosine, 1), share)
        line = "line" if entry["dim"] == 3 else "line_2d"  # in 2D drops stand in rows
        check(line, float(np.sqrt((rest**2).mean())), name, words)


WETTING_EXPERIMENT = Experiment(
    name="wetting", title="sessile drops on a plane: contact angle against adhesion", runs=wetting_planned,
    checks=wetting_checks,
)  # fmt: skip
