"""Young & Laplace: the pressure jump of drops at rest against their curvature, for every model of surface tension."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from validation.checks import Checks
from validation.experiment import Experiment, Results, RunSpec
from validation.measure.drops import MODELS, SWINGING, liquid_key, summed
from validation.measure.sigma_map import at_base, digest_of, drop_run, map_run, read_rows, words_of
from validation.measure.wetting import ROWS, condensed
from validation.results import Result, real
from validation.running import Context

LARGE = 10.0  # radius in spacings from which on the target holds
LEADING = "akinci"  # the model that calibrate takes where none is named


def settings(results: Results) -> list[dict[str, Any]]:
    """The map's entries."""
    return results["map"].values["settings"] if "map" in results else []


def checks(results: Results, check: Checks) -> None:
    """Every setting's tension is shown; how near the jump's and the frequency's are is judged."""
    for entry in settings(results):
        if at_base(entry) and math.isfinite(real(entry["laplace"])):
            check("sigma", entry["laplace"], f"map_{entry['model']}_{entry['dim']}d", words_of(entry))
    for entry in settings(results):
        for drop in entry["drops_by_radius"] if entry["dim"] == 3 and (at_base(entry) or not summed(entry)) else ():
            if drop["radius"] >= LARGE:
                liquid = "" if summed(entry) else ", advanced density"
                name = f"{entry['model']}_R{drop['radius']:g}{liquid_key(entry.get('liquid', 'summation'))}"
                label = f"{MODELS[entry['model']][0]}{liquid}, R = {drop['radius']:g} d"
                check("agreement_drops", apart_by(drop), name, label)
    known = {}
    for entry in settings(results):
        if entry["dim"] == 3 and summed(entry) and math.isfinite(value := farthest_apart(entry)):
            place = f"h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}"
            known[f"{MODELS[entry['model']][0]}, {place}"] = value
    if known:
        best = min(known, key=lambda name: known[name])
        check("best_agreement", known[best], "", best)
    for (liquid, radius), (off, spread) in swings(results["map"].values["rows"] if "map" in results else []).items():
        check("lamb", abs(off), f"{liquid}_R{radius:g}", f"{liquid}, R = {radius:g} d: {off:+.3f} +- {spread:.3f}")


def farthest_apart(entry: Mapping[str, Any]) -> float:
    """Largest |Laplace - Rayleigh| over their mean, of all radii of 10 spacings or more; NaN below three of them."""
    large = [apart_by(drop) for drop in entry["drops_by_radius"] if drop["radius"] >= LARGE]
    return max(large) if len(large) > 2 and all(map(math.isfinite, large)) else math.nan


def apart_by(entry: Mapping[str, Any]) -> float:
    """|Laplace - Rayleigh| over their mean; NaN where one is missing or no tension at all."""
    laplace, rayleigh = real(entry["laplace"]), real(entry["rayleigh"])
    return abs(laplace - rayleigh) / (0.5 * (laplace + rayleigh)) if min(laplace, rayleigh) > 0 else math.nan


def swings(rows: Sequence[Mapping[str, Any]]) -> dict[tuple[str, float], tuple[float, float]]:
    """Frequency of n = 2 over Lamb's of the same drop's jump, less one, of SWINGING: mean and deviation over seeds."""
    by_model: dict[tuple[str, float], list[float]] = {}
    for row in rows:
        if row["dim"] == 3 and row["radius"] in SWINGING and not row["stopped"]:
            off = math.sqrt(row["rayleigh"] / row["laplace"]) - 1
            by_model.setdefault((row.get("liquid", "summation"), row["radius"]), []).append(off)
    return {key: (float(np.mean(offs)), float(np.std(offs, ddof=1))) for key, offs in sorted(by_model.items())}


EXPERIMENT = Experiment(
    name="laplace", title="pressure jump of drops against 1/R, every model: what the surface tension really is",
    runs=lambda options: [map_run(), drop_run(LEADING, 2, 8.0, 1)], checks=checks,
)  # fmt: skip


# Sessile drops on a plane: the contact angle against the coefficient of adhesion, and the requested angle.


def published(context: Context, rows: str) -> Result:
    """The rows and settings on file; `rows` is the file's digest."""
    published_rows = read_rows(ROWS)
    return Result({"settings": condensed(published_rows), "rows": published_rows})


def setting_words(entry: Mapping[str, Any]) -> str:
    """A setting in words."""
    liquid = "" if summed(entry) else ", advanced"
    return f"{entry['dim']}D, h = {entry['support']:g} d, S = {entry['stiffness']:g}, {entry['kernels']}{liquid}"


def setting_name(entry: Mapping[str, Any]) -> str:
    """A setting as a part of a measurement's name."""
    place = f"{entry['dim']}d_{entry['kernels']}_h{entry['support']:g}_S{entry['stiffness']:g}"
    return place + liquid_key(entry.get("liquid", "summation"))


def wetting_checks(results: Results, check: Checks) -> None:
    """What the map shows."""
    for entry in settings(results):
        caps = [drop for drop in entry["drops"] if not math.isnan(real(drop["angle"]))]
        if len(caps) < 4:
            continue
        name, label = setting_name(entry), setting_words(entry)
        angles = np.array([drop["angle"] for drop in caps])
        check("span" if summed(entry) else "span_advanced", float(np.ptp(angles)), name, label)
        share, cosine = np.array([drop["share"] for drop in caps]), np.cos(np.radians(angles))
        rest = cosine - np.polyval(np.polyfit(share, cosine, 1), share)
        line = "line" if entry["dim"] == 3 else "line_2d"  # in 2D drops stand in rows
        check(line, float(np.sqrt((rest**2).mean())), name, label)


WETTING_EXPERIMENT = Experiment(
    "wetting",
    "sessile drops on a plane: contact angle against adhesion",
    runs=lambda options: [RunSpec("map", published, {"rows": digest_of(ROWS)})],
    checks=wetting_checks,
)
