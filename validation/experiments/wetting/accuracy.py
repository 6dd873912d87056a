"""What accuracy costs in contact angles: drops of several sizes on a plane, with the adhesion of `calibrate`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

from refsim import calibrate_contact_angle
from validation.checks import Checks
from validation.experiment import Band, Options, Panel, Run
from validation.measure.wetting import Point, measure
from validation.results import Result
from validation.running import Context
from validation.turns import Outcome, in_turns
from validation.work_precision import REPEATS

ANGLE = 90.0  # degrees
RADII = (5.0, 7.0, 10.0)  # of the half disc that a drop begins as [d]


def drop(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """A drop of its own seed, stirred, at rest and observed: its angle's distance from the requested one [degrees]."""
    found = calibrate_contact_angle(ANGLE, 1.0, spacing=1.0, rest_density=1.0, dim=2)
    began = time.perf_counter()
    row = measure(Point(found.share, 2, radius=setting["radius"], seed=10 + repeat), setting["knobs"]["backend"])
    spent = time.perf_counter() - began
    if row["stopped"] or row["fate"] != "cap":
        return Outcome(0.0, 0.0, spent, 1, row.get("particles", 0), stopped=row["stopped"] or f"{row['fate']}: no cap")
    return Outcome(row["angle"], abs(row["angle"] - ANGLE), spent, row["steps"], row["particles"])


def drops(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every size in turn, each repeat with another seed."""
    measure(Point(12.0, 2, radius=3.0), backend)  # compiles
    return in_turns(context, settings, drop, threads, repeats, backend)


def runs(options: Options) -> list[Run]:
    """One run, in which all sizes take turns; with --quick the smallest, once."""
    settings = {
        f"r{radius:g}": {
            "words": f"R = {radius:g} d",
            "knobs": {"spacing": 1.0 / radius, "dtype": "float32", "backend": options.backend, "model": "Akinci 2013"},
            "radius": radius,
        }
        for radius in (RADII[:1] if options.quick else RADII)
    }
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("drops", drops, parameters, estimate=15.0 if options.quick else 150.0)]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """Every drop keeps the stated error: the map of adhesion is read at one size and used at others."""
    for key, point in report["points"].items():
        if point["shown"] and not point["stopped"]:
            check("angle_error", point["error"], key, point["words"])


PANELS = (
    Panel(
        name="contact_angle",
        title="Contact angle of a 2D drop on a plane, 90 degrees requested",
        observable="distance from the requested angle [degrees]",
        reference="the requested angle, through the map of adhesion",
        stated=3.0,
        runs=runs,
        space=tuple(f"r{radius:g}" for radius in RADII),
        space_theory=None,
        time="the stable step alone",
        arithmetic="float32 alone",
        tolerance="no solver iterates",
        band=lambda points: Band(
            calibrate_contact_angle(ANGLE, 1.0, spacing=1.0, rest_density=1.0, dim=2).uncertainty,
            "uncertainty of the map",
        ),
        group="model",
        checks=checks,
        omissions=lambda options: ["3D drops: minutes each"],
    ),
)
