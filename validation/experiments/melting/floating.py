"""What accuracy costs in two-way coupling: a box that floats."""

from __future__ import annotations

from typing import Any

from validation.experiment import Options, Panel, Run
from validation.experiments.melting import float_runs
from validation.work_precision import REPEATS

FLOATING = (4, 6, 8, 10)  # cells of the box's edge


def floating_runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns; with --quick the coarsest, once."""
    settings: dict[str, dict[str, Any]] = {}

    def add(key: str, words: str, cells: int, step: float = 1.0, half_width: int = 2, dtype: str = "float32") -> None:
        knobs = {
            "spacing": float_runs.EDGE / cells, "step": step, "half_width": half_width, "dtype": dtype,
            "backend": options.backend, "scheme": f"w = {half_width}",
        }  # fmt: skip
        words = f"{cells} cells{words}, {dtype}"
        settings[key] = {"words": words, "knobs": knobs, "cells": cells, "half_width": half_width}

    for cells in FLOATING[:1] if options.quick else FLOATING:
        add(f"n{cells}", "", cells)
    if not options.quick:
        add("n6_half", ", half the step", 6, step=0.5)
        add("n6_w1", ", w = 1", 6, half_width=1)
        add("n6_float64", "", 6, dtype="float64")
    parameters = {
        "settings": settings, "backend": options.backend, "threads": options.threads,
        "repeats": 1 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("boxes", float_runs.boxes, parameters, estimate=3.0 if options.quick else 200.0)]


PANELS = (
    Panel(
        name="coupling",
        title="A box of half the water's density that floats",
        observable="height of its centre over the water's level, over its edge",
        reference="Archimedes: the centre floats at the level",
        stated=0.05,
        runs=floating_runs,
        space=tuple(f"n{cells}" for cells in FLOATING),
        space_theory=1.0,
        time=("n6", "n6_half"),
        time_theory=None,
        arithmetic=("n6", "n6_float64"),
        tolerance="no solver iterates",
        effects=(("w = 2 for w = 1", "n6_w1", "n6"),),
    ),
)
