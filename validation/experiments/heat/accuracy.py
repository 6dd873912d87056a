"""What accuracy costs in conduction of heat: every scheme over the step, against passes and seconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.checks import Checks
from validation.experiment import Options, Panel, Run
from validation.experiments.heat.accuracy_runs import fronts, melt_times
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
                 "backend": options.backend, "tolerance": more.get("tolerance", 4e-3)}  # fmt: skip
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
        "settings": settings(options), "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
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


MELTING_SCHEMES = ("implicit", "conjugate_gradient", "runge_kutta_legendre", "single_pass")
MELT_STEP = {"implicit": 2.0, "conjugate_gradient": 2.0, "runge_kutta_legendre": 2.0, "single_pass": 0.5}


def melting_settings(cells: tuple[int, ...], options: Options) -> dict[str, dict[str, Any]]:
    """Spacings by scheme, each at the step that MELT_STEP names, and one scheme at longer and shorter steps."""
    made: dict[str, dict[str, Any]] = {}

    def add(scheme: str, number: float, n: int) -> None:
        knobs = {"scheme": SCHEMES[scheme], "spacing": 1.0 / n, "step": number, "dtype": "float64",
                 "backend": options.backend}  # fmt: skip
        words = f"{SCHEMES[scheme]}, {n} spacings, steps of {number:g}"
        made[f"{scheme}_{n}_{number:g}"] = {
            "words": words, "knobs": knobs, "scheme": scheme, "cells": n, "number": number,
        }  # fmt: skip

    for scheme in MELTING_SCHEMES[:1] if options.quick else MELTING_SCHEMES:
        for n in cells[:2] if options.quick else cells:
            add(scheme, MELT_STEP[scheme], n)
    for number in (0.5, 8.0):
        add("implicit", number, cells[1])
    return made


FRONT_CELLS = (10, 20, 40)
BALL_CELLS = (5, 8, 12)


def front_runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": melting_settings(FRONT_CELLS, options), "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("fronts", fronts, parameters, estimate=60.0)]


def melt_runs(options: Options) -> list[Run]:
    """One run, in which all settings take turns."""
    parameters = {
        "settings": melting_settings(BALL_CELLS, options), "backend": options.backend, "threads": options.threads,
        "repeats": 2 if options.quick else REPEATS,
    }  # fmt: skip
    return [Run("melt_times", melt_times, parameters, estimate=60.0)]


def of_melting(cells: tuple[int, ...]) -> dict[str, Any]:
    """What both panels of melting have in common."""
    return {
        "space": tuple(f"implicit_{n}_2" for n in cells),
        "space_theory": 1.0,
        "time": tuple(f"implicit_{cells[1]}_{number:g}" for number in (8.0, 2.0, 0.5)),
        "time_theory": 1.0,
        "arithmetic": "conduction is stepped in float64 here",
        "tolerance": "measured in panel heat",
        "group": "scheme",
    }


PANELS = (
    Panel(
        name="melt_front",
        title="Depth of melting beside a hot wall, Stefan's problem; steps in k dt/(rho c d^2)",
        observable="largest error of the melted depth [%]",
        reference="2 lambda sqrt(t) of Stefan and Neumann, from the first held layer on",
        stated=5.0,
        runs=front_runs,
        **of_melting(FRONT_CELLS),
    ),
    Panel(
        name="melting",
        title="Time in which a ball of ice melts in warm water; steps in k dt/(rho c d^2)",
        observable="error of the melt time [%]",
        reference="a one-dimensional program, with the surface half a spacing beyond the particles",
        stated=1.0,
        runs=melt_runs,
        **of_melting(BALL_CELLS),
    ),
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
            "nonlinear Jacobi: for latent heat only (see the table of fronts)",
        ],
    ),
)
