"""What accuracy costs in conduction of heat: every scheme over the step, against passes and seconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.accuracy import Panel
from validation.checks import Checks
from validation.experiment import Options, Run
from validation.experiments.heat.runs import SLAB, slabs
from validation.work_precision import REPEATS

NUMBERS = (0.5, 2.0, 8.0)
MORE = {"explicit": (0.25,), "runge_kutta_legendre": (20.0,), "implicit": (20.0,), "conjugate_gradient": (20.0,)}
CELLS = 20
SCHEMES = {
    "one_sided": "R1", "pair_exchange": "R3", "single_pass": "NPX", "implicit": "Chebyshev", "conjugate_gradient": "CG",
    "runge_kutta_legendre": "RKL2", "explicit": "explicit",
}  # fmt: skip
LOOSE, TIGHT = 5e-2, 1e-4  # of Chebyshev's iteration, around the default of 4e-3


def settings(options: Options) -> dict[str, dict[str, Any]]:
    """Every scheme with every step, and what differs from them in one thing."""
    made: dict[str, dict[str, Any]] = {}

    def add(scheme: str, number: float, cells: int = CELLS, dtype: str = "float64", shown: bool = True,
            **more: Any) -> None:  # fmt: skip
        key = "_".join([scheme, f"{number:g}", *([] if cells == CELLS else [f"d{cells}"]),
                        *([] if dtype == "float64" else [dtype]), *(f"{v:g}" for v in more.values())])  # fmt: skip
        words = f"{SCHEMES[scheme]}, steps of {number:g}"
        words += "" if cells == CELLS else f", {cells} spacings"
        words += "" if dtype == "float64" else f", {dtype}"
        words += "".join(f", {name} {value:g}" for name, value in more.items())
        knobs = {"scheme": SCHEMES[scheme], "step": number, "spacing": SLAB / cells, "dtype": dtype,
                 "backend": "cpu", "tolerance": more.get("tolerance", 4e-3)}  # fmt: skip
        made[key] = {"words": words, "knobs": knobs, "scheme": scheme, "cells": cells, "number": number,
                     "options": more, "shown": shown}  # fmt: skip

    for scheme in SCHEMES:
        for number in sorted((*NUMBERS, *MORE.get(scheme, ()))):
            if not (options.quick and scheme == "pair_exchange" and number < 2):
                add(scheme, number)
    for cells in (10, 40):
        add("runge_kutta_legendre", 2.0, cells, shown=False)
    add("runge_kutta_legendre", 8.0, dtype="float32")
    add("conjugate_gradient", 4.0, shown=False)
    for tolerance in (LOOSE, TIGHT):
        add("implicit", 2.0, shown=False, tolerance=tolerance)
    return made


def runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": settings(options), "backend": "cpu", "threads": options.threads, "repeats": REPEATS,
    }  # fmt: skip
    return [Run("slabs", slabs, parameters, estimate=90.0)]


def checks(report: Mapping[str, Any], check: Checks) -> None:
    """The recommended scheme's error and passes are judged; all else is shown."""
    best = report["points"].get("runge_kutta_legendre_8")
    if best is not None:
        check("best_error", best["error"])
        check("best_passes", best["knobs"]["passes"])
    for key, point in report["points"].items():
        if point["shown"] and not point["stopped"]:
            check("passes", point["knobs"]["passes"], key, point["words"])


PANELS = (
    Panel(
        name="heat",
        title="A cosine in a slab of 20 spacings; steps in k dt/(rho c d^2)",
        observable="rms error [% of the range]",
        reference="50 + 50 cos(pi x/L) exp(-pi^2 t/L^2)",
        stated=0.5,
        runs=runs,
        space=("runge_kutta_legendre_2_d10", "runge_kutta_legendre_2", "runge_kutta_legendre_2_d40"),
        time=("conjugate_gradient_8", "conjugate_gradient_4", "conjugate_gradient_2"),
        time_theory=1.0,
        arithmetic=("runge_kutta_legendre_8_float32", "runge_kutta_legendre_8"),
        tolerance=(f"implicit_2_{LOOSE:g}", "implicit_2", f"implicit_2_{TIGHT:g}"),
        group="scheme",
        effects=(("float64 for float32", "runge_kutta_legendre_8_float32", "runge_kutta_legendre_8"),),
        checks=checks,
        omissions=lambda options: [
            "backend cuda: one launch for each pass; it was not timed here",
            "nonlinear Jacobi: for latent heat only (see the table of fronts)",
        ],
    ),
)
