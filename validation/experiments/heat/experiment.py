"""Heat conduction: slab, sphere, Stefan's problem and a melting sphere by every scheme, orders, ledgers and ranges."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run, measures
from validation.experiments.heat import claims, pictures, runs, stability
from validation.experiments.heat.pictures import SCHEMES
from validation.results import real
from validation.work_precision import Order, order_from_errors

PLAIN = tuple(name for name in SCHEMES if name != "nonlinear_jacobi")
MELTING = ("runge_kutta_legendre", "implicit", "conjugate_gradient", "nonlinear_jacobi", "single_pass")
KEEPING = ("pair_exchange", "single_pass", "implicit", "conjugate_gradient", "runge_kutta_legendre")
SPHERES, COLUMNS = (7, 10, 14, 20), (20, 40, 80)
BOUNDED = (
    ("single_pass", False), ("conjugate_gradient", False), ("implicit", False), ("single_pass", True),
    ("nonlinear_jacobi", True), ("implicit", True),
)  # fmt: skip
THEORY = {
    "explicit": 1.0, "one_sided": None, "single_pass": 1.0, "pair_exchange": 2.0, "implicit": 1.0,
    "conjugate_gradient": 1.0, "runge_kutta_legendre": 2.0,
}  # fmt: skip
BEST = "runge_kutta_legendre"
DTYPES = ("float64", "float32")


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    slow = "takes minutes with the others; run without --quick" if options.quick else ""
    fast = ("implicit", BEST, "single_pass")
    sphere, stefan = {"cells": 10, "numbers": [0.25, 2.0, 8.0]}, {"cells": 40, "numbers": [0.5, 2.0, 8.0]}
    return [
        *(Run(f"slab_{name}", runs.slab, {"scheme": name}, 40.0 if name == "pair_exchange" else 4.0,
              "" if name in fast else slow) for name in PLAIN),
        *(Run(f"step_{name}", runs.order_in_step, {"scheme": name}, 5.0, slow) for name in PLAIN),
        Run("pair_orders", runs.pair_orders, {}, 20.0, slow),
        Run("spacing", runs.order_in_spacing, {}, 4.0),
        *(Run(f"sphere_{name}", runs.sphere, {"scheme": name, **sphere}, 8.0, slow)
          for name in PLAIN if name != "one_sided"),
        *(Run(f"spheres_{cells}", runs.sphere, {"scheme": BEST, "cells": cells, "numbers": [0.5]}, 0.002 * cells**3,
              slow if cells > 14 else "") for cells in SPHERES),
        *(Run(f"stefan_{name}", runs.stefan, {"scheme": name, **stefan}, 6.0, "" if name == BEST else slow)
          for name in MELTING),
        *(Run(f"columns_{cells}", runs.stefan, {"scheme": BEST, "cells": cells, "numbers": [2.0]}, 4.0)
          for cells in COLUMNS),
        Run("oracle", runs.oracle, {}, 8.0, slow),
        *(Run(f"melting_{name}_{cells}", runs.melting_sphere, {"scheme": name, "cells": cells, "number": number},
              0.005 * cells**3, slow if cells > 10 else "")
          for name, cells, number in ((BEST, 10, 2.0), (BEST, 20, 2.0), ("implicit", 20, 0.5))),
        *(Run(f"ledger_{name}_{dtype}", runs.ledger, {"scheme": name, "dtype": dtype}, 10.0, slow)
          for name in (*KEEPING, "one_sided") for dtype in DTYPES),
        *(Run(range_key(name, melts), runs.ranges, {"scheme": name, "melts": melts}, 3.0, slow)
          for name, melts in BOUNDED),
        Run("speed", runs.speed, {"threads": options.threads or 2}, 20.0, slow),
    ]  # fmt: skip


def range_key(scheme: str, melts: bool) -> str:
    """Key of the run in which a scheme's temperatures are held against their range."""
    return f"range_{scheme}{'_ice' if melts else ''}"


def rows_of(results: Results, key: str) -> list[dict[str, Any]]:
    """The rows of a run; none where it was not performed."""
    return results[key].values["rows"] if key in results else []


def order_of(rows: list[dict[str, Any]], theory: float | None, error: str = "error") -> Order:
    """Observed order over sizes."""
    return order_from_errors([real(row["size"]) for row in rows], [real(row[error]) for row in rows], theory)


def order_over(results: Results, keys: list[str], error: str) -> Order | None:
    """Observed order over several runs of one row each; None where one of them was not performed."""
    rows = [row for key in keys for row in rows_of(results, key)]
    return order_of(rows, 1.0, error) if len(rows) == len(keys) else None


REFINED = {  # check: (keys of the runs, what their sizes are called)
    "sphere": ([f"spheres_{cells}" for cells in SPHERES], "R = {:.0f} d"),
    "stefan": ([f"columns_{cells}" for cells in COLUMNS], "{:.0f} spacings"),
}


def checks(results: Results, check: Checks) -> None:
    """What each bar is held against."""
    for name in PLAIN:
        rows = rows_of(results, f"slab_{name}")
        for row in rows:
            key = f"slab_{name}_{row['number']:g}".replace(".", "_")
            own = key in check.entries
            run = "" if own else f"{name}_{row['number']:g}"
            check(key if own else "slab_error", row["error"], run, f"{SCHEMES[name]}, {row['number']:g}")
        if rows:
            drift = max(abs(real(row["drift"])) for row in rows)
            check("slab_drift" if name in KEEPING else "drift", drift, name, SCHEMES[name])
    if "pair_orders" in results:
        for words, rows in results["pair_orders"].values["orders"].items():
            for row in rows:
                check("pair_order", row["error"], f"{words.replace(' ', '_')}_{row['number']:g}",
                     f"{words}, {row['number']:g}")  # fmt: skip
    if rows := rows_of(results, "spacing"):
        check("order_in_spacing", order_of(rows, 2.0).order)
    for name in PLAIN:
        if rows := rows_of(results, f"step_{name}"):
            check(f"order_{name}", order_of(rows, THEORY[name]).order)
    for what, (keys, words) in REFINED.items():
        for key in keys:
            for row in rows_of(results, key):
                check(f"{what}_raw", row["raw"], key, words.format(1 / row["size"]))
                check(f"{what}_shifted", row["shifted"], key, words.format(1 / row["size"]))
        if order := order_over(results, keys, "raw"):
            check(f"{what}_order", order.order)
        for name in PLAIN if what == "sphere" else MELTING:
            for row in rows_of(results, f"{what}_{name}"):
                run, number = f"{name}_{row['number']:.2g}", f"{row['number']:.2g}"
                check(f"{what}_scheme", row["shifted"], run, SCHEMES[name] if what == "sphere" else f"{name}, {number}")
    if "oracle" in results:
        for name in ("refinement", "quasi_steady", "plane"):
            check(f"oracle_{name}", abs(real(results["oracle"].values[name])))
    for key in (f"{BEST}_10", f"{BEST}_20", "implicit_20"):
        if f"melting_{key}" in results:
            values = results[f"melting_{key}"].values
            bar = "melting_front" if key == f"{BEST}_20" else "melting_front_other"
            words = f"{values['scheme']}, R = {values['cells']} d"
            check(bar, values["raw"], f"{key}_raw", f"{words}, as it is")
            check(bar, values["shifted"], f"{key}_shifted", f"{words}, from the first held layer")
            late = 100 * (values["melted"] / values["melted_exactly"] - 1)
            check("melting_time", late, key, words)
    for name in (*KEEPING, "one_sided"):
        for dtype in DTYPES:
            if f"ledger_{name}_{dtype}" in results:
                values = results[f"ledger_{name}_{dtype}"].values
                check(f"ledger_{dtype}" if name in KEEPING else "ledger_one_sided", values["largest"],
                     name if name in KEEPING else dtype, f"{SCHEMES[name]}, {dtype}")  # fmt: skip
                if values["melted"]:
                    check("ledger_melted", values["melted"], f"{name}_{dtype}", f"{name}, {dtype}")
    if "speed" in results:
        for name, ratio in results["speed"].values["ratio"].items():
            check("speed", ratio, name.replace(" ", "_"), name)
    for name, melts in BOUNDED:
        if rows := rows_of(results, range_key(name, melts)):
            bar = "range_solved" if name in ("conjugate_gradient", "implicit") else "range"
            words = f"{SCHEMES[name]}{', with latent heat' if melts else ''}"
            check(bar, max(real(row["beyond"]) for row in rows), range_key(name, melts), words)


EXPERIMENT = Experiment(
    name="heat",
    title="conduction of heat: slab, sphere, Stefan's problem and a melting sphere by every scheme, and who keeps heat",
    runs=planned,
    checks=checks,
    pictures=(
        Picture("heat_schemes", pictures.schemes_data, pictures.schemes, ("slab_implicit", f"slab_{BEST}")),
        Picture(
            "heat_profiles", pictures.profiles_data, pictures.profiles,
            ("slab_one_sided", "slab_runge_kutta_legendre", f"sphere_{BEST}", f"stefan_{BEST}", "stefan_implicit"),
        ),
        Picture(
            "heat_fronts", pictures.fronts_data, pictures.fronts, (f"stefan_{BEST}", f"melting_{BEST}_20", "oracle")
        ),
    ),
    claims=measures(claims),
    trials=vars(stability),
    maps=stability.MAPS,
)  # fmt: skip
