"""What accuracy costs in surface tension: drops of several sizes in the plane, by their pressure jump and by their
frequency."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

from refsim.surface_tension.calibration import sigma_map
from validation.experiment import Band, Options, Panel, Points, Run
from validation.measure.drops import MODELS, Point, at_base, base, measure
from validation.results import Result
from validation.running import Context
from validation.turns import Outcome, in_turns
from validation.work_precision import REPEATS

TENSIONS = ("akinci", "jiang_zhu", "dong")
RADII = {"laplace": (8.0, 11.0, 16.0, 24.0), "rayleigh": (11.0, 16.0, 24.0)}  # [d]
SEED = 10  # of the first repeat: the map holds seeds 1 to 3


def flat_tension(model: str) -> tuple[float, float]:
    """Tension of a flat surface over the nominal one in 2D, and its standard error, from the map's pressure jumps."""
    entry = next(e for e in sigma_map() if e["model"] == model and e["dim"] == 2 and at_base(model, e))
    return entry["flat_laplace"], entry["flat_laplace_error"]


def drop(context: Context, setting: Mapping[str, Any], repeat: int) -> Outcome:
    """A drop of its own seed: R P over the flat tension, or its frequency over Lamb's with the flat tension."""
    by, model, knobs = setting["by"], setting["model"], setting["knobs"]
    point = Point(model, 2, radius=setting["radius"], seed=SEED + repeat, kicked=by == "rayleigh",
                  backend=knobs["backend"], dtype=knobs["dtype"], **base(model))  # fmt: skip
    began = time.perf_counter()
    row = measure(point)
    spent = time.perf_counter() - began
    if row["stopped"]:
        return Outcome(0.0, 0.0, spent, 1, row.get("particles", 0), stopped=row["stopped"])
    share = row[by] / flat_tension(model)[0]
    value = math.sqrt(max(share, 0.0)) if by == "rayleigh" else share
    return Outcome(value, abs(value - 1), spent, row["steps"], row["particles"])


def drops(
    context: Context, settings: Mapping[str, Mapping[str, Any]], backend: str, threads: int | None, repeats: int
) -> Result:
    """Every setting in turn, each repeat with another seed."""
    for setting in settings.values():  # compiles
        drop(context, {**setting, "radius": 4.0}, 0)
    return in_turns(context, settings, drop, threads, repeats, backend)


def runs(by: str, options: Options) -> list[Run]:
    """One run, in which all settings take turns; with --quick the smallest drop of one model, once."""
    settings: dict[str, dict[str, Any]] = {}

    def add(model: str, radius: float, dtype: str = "float32") -> None:
        name = MODELS[model][0]
        knobs = {"spacing": 1.0 / radius, "dtype": dtype, "backend": options.backend, "model": name}
        last = "_float64" if dtype == "float64" else ""
        settings[f"{model}_r{radius:g}{last}"] = {
            "words": f"{name}, R = {radius:g} d, {dtype}", "knobs": knobs, "radius": radius, "model": model, "by": by,
        }  # fmt: skip

    for model in TENSIONS[:1] if options.quick else TENSIONS:
        for radius in RADII[by][:1] if options.quick else RADII[by]:
            add(model, radius)
    if not options.quick:
        add(TENSIONS[0], 16.0, "float64")
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run(by, drops, parameters, estimate=5.0 if options.quick else 200.0)]


def panel(name: str, by: str, title: str, observable: str, reference: str, part: float) -> Panel:
    """The panel of pressure jumps or of frequencies; a relative error of the tension is `part` of it in the value."""

    def band(points: Points) -> Band:
        value, error = flat_tension(TENSIONS[0])
        return Band(part * error / value, "uncertainty of Akinci's flat tension")

    return Panel(
        name=name,
        title=title,
        observable=observable,
        reference=reference,
        stated=0.05,
        runs=lambda options: runs(by, options),
        space=tuple(f"{TENSIONS[0]}_r{radius:g}" for radius in RADII[by]),
        space_theory=1.0 if by == "laplace" else None,
        time="the stable step alone",
        arithmetic=(f"{TENSIONS[0]}_r16", f"{TENSIONS[0]}_r16_float64"),
        tolerance="no solver iterates",
        exact=False,
        band=band,
        group="model",
        lines=[(MODELS[m][0], [f"{m}_r{radius:g}" for radius in RADII[by]]) for m in TENSIONS],
        omissions=lambda options: ["drops in 3D: minutes each; their tensions stand in the map of tensions"],
    )


PANELS = (
    panel(
        "surface_tension_jump",
        "laplace",
        "Surface tension by the pressure jump of 2D drops",
        "R P over the model's flat tension, distance from 1",
        "the model's own tension at a flat surface: limit of 1/R to 0 in the map of tensions",
        1.0,
    ),
)
OSCILLATION_PANELS = (
    panel(
        "surface_tension_frequency",
        "rayleigh",
        "Frequency of mode 2 of 2D drops",
        "frequency over Rayleigh's, distance from 1",
        "Rayleigh's frequency with the model's tension at a flat surface, which its pressure jumps give",
        0.5,
    ),
)
