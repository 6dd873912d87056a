"""Young & Laplace: the pressure jump of drops at rest against their curvature, for every model of surface tension."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from refsim import calibrate, calibrate_contact_angle
from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, RunSpec
from validation.measure.drops import MODELS, SEEDED, SWINGING, fit_laplace, liquid_key, summed
from validation.measure.sigma_map import at_base, digest_of, drop_run, map_run, read_rows, words_of
from validation.measure.wetting import ROWS, SIZE, Point, condensed, measure
from validation.results import Result, real
from validation.running import Context

LARGE = 10.0  # radius in spacings from which on the target holds
LEADING = "akinci"  # the model that calibrate takes where none is named
MEASURED = {2: (8.0, 11.0, 16.0, 24.0), 3: (8.5, 10.0, 12.0, 14.0)}  # radii in spacings, of R >= 3 h


def planned(options: Options) -> list[RunSpec]:
    """The published map, and drops of four radii (three with --quick, in 2D only) measured now, three seeds of one."""
    made = [map_run()]
    for dim, radii in MEASURED.items():
        if options.quick and dim == 3:
            continue
        for radius in radii[:3] if options.quick else radii:
            seeds = (1, 2, 3) if radius == SEEDED[dim] and not options.quick else (1,)
            made += [drop_run(LEADING, dim, radius, seed) for seed in seeds]
    return made


def measured_now(results: Results, dim: int) -> list[Mapping[str, Any]]:
    """Rows of the drops of one dimension that were measured now."""
    return [r.values for key, r in results.items() if key != "map" and r.values["dim"] == dim]


def settings(results: Results) -> list[dict[str, Any]]:
    """The map's entries."""
    return results["map"].values["settings"] if "map" in results else []


def checks(results: Results, check: Checks) -> None:
    """Every setting's tension is shown; how well the jump of the drops measured now follows 1/R is judged."""
    for dim in MEASURED:
        rows = measured_now(results, dim)
        if not rows:
            continue
        slope, error, intercept = fit_laplace(rows)
        name, words = f"{LEADING}_{dim}d", f"{MODELS[LEADING][0]}, {dim}D, measured now"
        check("sigma", slope, name, words)
        check("fit_error", error / slope if slope else math.nan, name, words)
        largest = max(row["radius"] for row in rows if not row["stopped"])
        check("left_over", abs(intercept) * largest / ((dim - 1) * slope), name, words)
    for entry in settings(results):
        if at_base(entry) and math.isfinite(real(entry["laplace"])):
            check("sigma", entry["laplace"], f"map_{entry['model']}_{entry['dim']}d", words_of(entry))
    for entry in settings(results):
        for drop in entry["drops_by_radius"] if entry["dim"] == 3 and (at_base(entry) or not summed(entry)) else ():
            if drop["radius"] >= LARGE:
                liquid = "" if summed(entry) else ", advanced density"
                name = f"{entry['model']}_R{drop['radius']:g}{liquid_key(entry.get('liquid', 'summation'))}"
                words = f"{MODELS[entry['model']][0]}{liquid}, R = {drop['radius']:g} d"
                check("agreement_drops", apart_by(drop), name, words)
    known = {}
    for entry in settings(results):
        if entry["dim"] == 3 and summed(entry) and math.isfinite(value := farthest_apart(entry)):
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


def oscillation_planned(options: Options) -> list[RunSpec]:
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
    for (liquid, radius), (off, spread) in swings(results["map"].values["rows"] if "map" in results else []).items():
        check("lamb", abs(off), f"{liquid}_R{radius:g}", f"{liquid}, R = {radius:g} d: {off:+.3f} +- {spread:.3f}")


def swings(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, float], tuple[float, float]]:
    """Frequency of n = 2 over Lamb's of the same drop's jump, less one, of SWINGING: mean and deviation over seeds."""
    found: dict[tuple[str, float], list[float]] = {}
    for row in rows:
        if row["dim"] == 3 and row["radius"] in SWINGING and not row["stopped"]:
            off = math.sqrt(row["rayleigh"] / row["laplace"]) - 1
            found.setdefault((row.get("liquid", "summation"), row["radius"]), []).append(off)
    return {key: (float(np.mean(offs)), float(np.std(offs, ddof=1))) for key, offs in sorted(found.items())}


def requested(row: Mapping[str, Any]) -> dict[str, float]:
    """Relative difference of both tensions of a drop from the one requested of `calibrate`."""
    place = {"dim": row["dim"], "radius": row["radius"], "spacing": 1.0, "rest_density": 1.0}
    ratio = calibrate(1.0, row["model"], **place).ratio  # measured over nominal tension
    return {name.capitalize(): abs(row[name] / ratio - 1) for name in ("laplace", "rayleigh")}


OSCILLATION_EXPERIMENT = Experiment(
    name="oscillation", title="frequency of kicked drops, mode n = 2, every model: tension by Rayleigh",
    runs=oscillation_planned, checks=oscillation_checks,
)  # fmt: skip


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
    liquid = "" if summed(entry) else ", advanced"
    return f"{entry['dim']}D, h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}{liquid}"


def setting_name(entry: Mapping[str, Any]) -> str:
    """A setting as a part of a measurement's name."""
    place = f"{entry['dim']}d_{entry['kernels']}_h{entry['support']:g}_S{entry['stiffness']:g}"
    return place + liquid_key(entry.get("liquid", "summation"))


def wetting_planned(options: Options) -> list[RunSpec]:
    """The published map, and drops measured now for requested angles: with --quick one in 2D."""
    made = [RunSpec("map", published, {"rows": digest_of(ROWS)}, estimate=1.0)]
    if options.quick:
        return [*made, RunSpec("asked_2d_90", asked, {"dim": 2, "radius": 10.0, "angle": 90.0}, estimate=6.0)]
    for dim, angles in ASKED.items():
        for angle in angles:
            drop = {"dim": dim, "radius": SIZE[dim], "angle": angle}
            made.append(RunSpec(f"asked_{dim}d_{angle:g}", asked, drop, estimate=20.0))
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
