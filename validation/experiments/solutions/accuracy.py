"""What accuracy costs in the pressure of a tank at rest: implicit and weakly compressible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.checks import Checks
from validation.experiment import Options, Panel, Run
from validation.experiments.solutions import pressure_runs
from validation.work_precision import REPEATS

CELLS = (10, 20, 40)
IMPLICIT, STATE = "implicit", "weakly compressible"


def runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns; with --quick the coarsest of both, once."""
    settings: dict[str, dict[str, Any]] = {}

    def add(key: str, words: str, cells: int, tolerance: float, step: float = 1.0, dtype: str = "float32") -> None:
        method = IMPLICIT if tolerance else STATE
        knobs = {
            "spacing": pressure_runs.HEIGHT / cells, "step": step, "dtype": dtype, "backend": options.backend,
            "pressure": method, "tolerance": tolerance,
        }  # fmt: skip
        words = f"{method}, d = H/{cells}{words}, {dtype}"
        settings[key] = {"words": words, "knobs": knobs, "cells": cells, "tolerance": tolerance}

    for cells in CELLS[:1] if options.quick else CELLS:
        add(f"state_{cells}", "", cells, 0.0)
        add(f"implicit_{cells}", ", tolerance 0.1 %", cells, 1e-3)
    if not options.quick:
        for cells in CELLS:
            add(f"implicit_{cells}_long", ", tolerance 0.1 %, four times the step", cells, 1e-3, step=4.0)
        add("state_80", "", 80, 0.0)
        add("implicit_20_loose", ", tolerance 1 %", 20, 1e-2)
        add("implicit_20_tight", ", tolerance 0.01 %", 20, 1e-4)
        add("implicit_20_half", ", tolerance 0.1 %, half the step", 20, 1e-3, step=0.5)
        add("implicit_20_float64", ", tolerance 0.1 %", 20, 1e-3, dtype="float64")
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("tanks", pressure_runs.tanks, parameters, estimate=3.0 if options.quick else 120.0)]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """The default of either pressure at d = H/20 is judged."""
    for key in ("state_20", "implicit_20"):
        point = report["points"].get(key)
        if point is not None and not point["stopped"]:
            check("pressure_error", point["error"], key, point["words"])


PANELS = (
    Panel(
        name="implicit_pressure",
        title="Pressure of a tank at rest, implicit and weakly compressible",
        observable="rms error of the pressure over rho g H",
        reference="hydrostatic pressure",
        stated=0.05,
        runs=runs,
        space=tuple(f"implicit_{cells}" for cells in CELLS),
        space_theory=None,
        time=("implicit_20_long", "implicit_20", "implicit_20_half"),
        time_theory=None,
        arithmetic=("implicit_20", "implicit_20_float64"),
        tolerance=("implicit_20_loose", "implicit_20", "implicit_20_tight"),
        group="pressure",
        checks=checks,
        lines=(
            (STATE, [*(f"state_{cells}" for cells in CELLS), "state_80"]),
            (IMPLICIT, [f"implicit_{cells}" for cells in CELLS]),
            (f"{IMPLICIT}, long steps", [f"implicit_{cells}_long" for cells in CELLS]),
        ),
    ),
)
