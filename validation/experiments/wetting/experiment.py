"""Sessile drops on a plane: the contact angle against the coefficient of adhesion, and the requested angle."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np

from refsim import calibrate_contact_angle
from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.wetting import pictures
from validation.measure.wetting import ROWS, SIZE, Point, condensed, measure, read_rows
from validation.results import Result, real
from validation.running import Context

ASKED = {2: (70.0, 110.0), 3: (70.0, 90.0, 115.0)}  # degrees
UNSEEN = 4  # seed that is not in the map


def published(context: Context, rows: str) -> Result:
    """The rows and settings on file; `rows` is the file's digest."""
    found = read_rows()
    return Result({"settings": condensed(found), "rows": found})


def asked(context: Context, dim: int, radius: float, angle: float) -> Result:
    """A drop with the adhesion that `calibrate_contact_angle` gives for an angle, of a seed not in the map."""
    found = calibrate_contact_angle(angle, 1.0, spacing=1.0, rest_density=1.0, dim=dim)
    row = measure(Point(found.share, dim, radius=radius, seed=UNSEEN))
    return Result({**row, "asked": angle, "uncertainty": found.uncertainty})


def planned(options: Options) -> list[Run]:
    """The published map, and drops measured now for requested angles: with --quick one in 2D."""
    made = [Run("map", published, {"rows": hashlib.sha256(ROWS.read_bytes()).hexdigest()[:16]}, estimate=1.0)]
    if options.quick:
        return [*made, Run("asked_2d_90", asked, {"dim": 2, "radius": 10.0, "angle": 90.0}, estimate=6.0)]
    for dim, angles in ASKED.items():
        for angle in angles:
            drop = {"dim": dim, "radius": SIZE[dim], "angle": angle}
            made.append(Run(f"asked_{dim}d_{angle:g}", asked, drop, estimate=20.0))
    return made


def checks(results: Results, check: Checks) -> None:
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
        name, words = pictures.name_of(entry), pictures.words_of(entry)
        angles = np.array([drop["angle"] for drop in caps])
        check("span", float(np.ptp(angles)), name, words)
        share, cosine = np.array([drop["share"] for drop in caps]), np.cos(np.radians(angles))
        rest = cosine - np.polyval(np.polyfit(share, cosine, 1), share)
        line = "line" if entry["dim"] == 3 else "line_2d"  # in 2D drops stand in rows
        check(line, float(np.sqrt((rest**2).mean())), name, words)


def settings(results: Results) -> list[dict[str, Any]]:
    """The map's entries."""
    return results["map"].values["settings"] if "map" in results else []


EXPERIMENT = Experiment(
    name="wetting",
    title="sessile drops on a plane: contact angle against adhesion",
    runs=planned,
    checks=checks,
    pictures=(Picture("wetting", pictures.data, pictures.picture, ("map",)),),
)
