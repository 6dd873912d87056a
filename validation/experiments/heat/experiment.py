"""Heat conduction: slab, sphere, Stefan's problem and a melting sphere by every scheme, orders, ledgers and ranges."""

from __future__ import annotations

from typing import Any

from validation.checks import Checks
from validation.claims import measures
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.heat import accuracy, claims, pictures, runs, stability
from validation.experiments.heat.pictures import SCHEMES
from validation.results import Result, real
from validation.tables import Table
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


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    slow = "takes minutes with the others; run without --quick" if options.quick else ""
    made = []
    for name in PLAIN:
        fast = name in ("implicit", BEST, "single_pass")
        made.append(Run(f"slab_{name}", runs.slab, {"scheme": name}, 40.0 if name == "pair_exchange" else 4.0,
                        "" if fast else slow))  # fmt: skip
        made.append(Run(f"step_{name}", runs.order_in_step, {"scheme": name}, 5.0, slow))
    made.append(Run("pair_orders", runs.pair_orders, {}, 20.0, slow))
    made.append(Run("spacing", runs.order_in_spacing, {}, 4.0))
    for name in PLAIN:
        if name != "one_sided":
            made.append(Run(f"sphere_{name}", runs.sphere, {"scheme": name, "cells": 10, "numbers": [0.25, 2.0, 8.0]},
                            8.0, slow))  # fmt: skip
    for cells in SPHERES:
        parameters = {"scheme": BEST, "cells": cells, "numbers": [0.5]}
        made.append(Run(f"spheres_{cells}", runs.sphere, parameters, 0.002 * cells**3, slow if cells > 14 else ""))
    for name in MELTING:
        parameters = {"scheme": name, "cells": 40, "numbers": [0.5, 2.0, 8.0]}
        made.append(Run(f"stefan_{name}", runs.stefan, parameters, 6.0, "" if name == BEST else slow))
    for cells in COLUMNS:
        made.append(Run(f"columns_{cells}", runs.stefan, {"scheme": BEST, "cells": cells, "numbers": [2.0]}, 4.0))
    made.append(Run("oracle", runs.oracle, {}, 8.0, slow))
    for name, cells, number in ((BEST, 10, 2.0), (BEST, 20, 2.0), ("implicit", 20, 0.5)):
        parameters = {"scheme": name, "cells": cells, "number": number}
        made.append(Run(f"melting_{name}_{cells}", runs.melting_sphere, parameters, 0.005 * cells**3,
                        slow if cells > 10 else ""))  # fmt: skip
    for name in (*KEEPING, "one_sided"):
        for dtype in ("float64", "float32"):
            parameters = {"scheme": name, "dtype": dtype}
            made.append(Run(f"ledger_{name}_{dtype}", runs.ledger, parameters, 10.0, slow))
    for name, melts in BOUNDED:
        parameters = {"scheme": name, "melts": melts}
        made.append(Run(f"range_{name}{'_ice' if melts else ''}", runs.ranges, parameters, 3.0, slow))
    made.append(Run("speed", runs.speed, {"threads": options.threads or 2}, 20.0, slow))
    return made


def order_of(result: Result, theory: float | None, error: str = "error") -> Order:
    """Observed order of one sequence of sizes."""
    rows = result.values["rows"]
    return order_from_errors([real(row["size"]) for row in rows], [real(row[error]) for row in rows], theory)


def order_over(results: Results, keys: list[str], error: str) -> Order:
    """Observed order over several runs' first rows."""
    rows = [results[key].values["rows"][0] for key in keys if key in results]
    return order_from_errors([real(row["size"]) for row in rows], [real(row[error]) for row in rows], 1.0)


def checks(results: Results, check: Checks) -> None:
    """What each bar is held against."""
    for name in PLAIN:
        if f"slab_{name}" not in results:
            continue
        rows = results[f"slab_{name}"].values["rows"]
        for row in rows:
            key = f"slab_{name}_{row['number']:g}".replace(".", "_")
            own = key in check.bars
            run = "" if own else f"{name}_{row['number']:g}"
            check(key if own else "slab_error", row["error"], run, f"{SCHEMES[name]}, {row['number']:g}")
        drift = max(abs(real(row["drift"])) for row in rows)
        check("slab_drift" if name in KEEPING else "drift", drift, name, SCHEMES[name])
    if "pair_orders" in results:
        for words, rows in results["pair_orders"].values["orders"].items():
            for row in rows:
                check("pair_order", row["error"], f"{words.replace(' ', '_')}_{row['number']:g}",
                     f"{words}, {row['number']:g}")  # fmt: skip
    if "spacing" in results:
        check("order_in_spacing", order_of(results["spacing"], 2.0).order)
    for name in PLAIN:
        if f"step_{name}" in results:
            key = f"order_{name}"
            check(key, order_of(results[f"step_{name}"], THEORY[name]).order)
    spheres = [f"spheres_{cells}" for cells in SPHERES]
    for key in spheres:
        if key in results:
            (row,) = results[key].values["rows"]
            check("sphere_raw", row["raw"], key, f"R = {1 / row['size']:.0f} d")
            check("sphere_shifted", row["shifted"], key, f"R = {1 / row['size']:.0f} d")
    if all(key in results for key in spheres):
        check("sphere_order", order_over(results, spheres, "raw").order)
    for name in PLAIN:
        if f"sphere_{name}" in results:
            for row in results[f"sphere_{name}"].values["rows"]:
                check("sphere_scheme", row["shifted"], f"{name}_{row['number']:.2g}", SCHEMES[name])
    columns = [f"columns_{cells}" for cells in COLUMNS]
    for key in columns:
        if key in results:
            (row,) = results[key].values["rows"]
            check("stefan_raw", row["raw"], key, f"{1 / row['size']:.0f} spacings")
            check("stefan_shifted", row["shifted"], key, f"{1 / row['size']:.0f} spacings")
    if all(key in results for key in columns):
        check("stefan_order", order_over(results, columns, "raw").order)
    for name in MELTING:
        if f"stefan_{name}" in results:
            for row in results[f"stefan_{name}"].values["rows"]:
                check("stefan_scheme", row["shifted"], f"{name}_{row['number']:.2g}", f"{name}, {row['number']:.2g}")
    if "oracle" in results:
        values = results["oracle"].values
        for name in ("refinement", "quasi_steady", "plane"):
            check(f"oracle_{name}", abs(real(values[name])))
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
        for dtype in ("float64", "float32"):
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
        key = f"range_{name}{'_ice' if melts else ''}"
        if key in results:
            beyond = max(real(row["beyond"]) for row in results[key].values["rows"])
            bar = {"conjugate_gradient": "range_solved", "implicit": "range_solved"}.get(name, "range")
            check(bar, beyond, key, f"{SCHEMES[name]}{', with latent heat' if melts else ''}")


def tables(results: Results) -> list[Table]:
    """Errors by scheme and step, orders, sphere, fronts, ledgers."""
    made = []
    rows: list[list[Any]] = [
        [SCHEMES[name], *(row["error"] for row in results[f"slab_{name}"].values["rows"])]
        for name in PLAIN
        if f"slab_{name}" in results
    ]
    if rows:
        note = "rms error in % of the range, by k dt/(rho c d^2); half a cosine in 40 spacings, h = 2.5 d, float64."
        made.append(Table("A cosine in a slab", ["scheme", *(f"{n:g}" for n in runs.NUMBERS)], rows, note))
    rows = []
    if "spacing" in results:
        rows.append(["spacing, RKL2", order_of(results["spacing"], 2.0).words])
    for name in PLAIN:
        if f"step_{name}" in results:
            rows.append([f"step, {SCHEMES[name]}", order_of(results[f"step_{name}"], THEORY[name]).words])
    for words, keys in (("sphere, spacing", [f"spheres_{c}" for c in SPHERES]),
                        ("Stefan, spacing", [f"columns_{c}" for c in COLUMNS])):  # fmt: skip
        if all(key in results for key in keys):
            rows.append([f"{words}, as it is", order_over(results, keys, "raw").words])
            rows.append([f"{words}, from the first held layer", order_over(results, keys, "shifted").words])
    if rows:
        note = "Spacing against the exact solution, step against the same particles with a step that costs nothing."
        made.append(Table("Observed orders of convergence", ["in", "order"], rows, note))
    rows = [
        [SCHEMES[name], f"{row['number']:.3g}", row["raw"], row["shifted"]]
        for name in PLAIN
        if f"sphere_{name}" in results
        for row in results[f"sphere_{name}"].values["rows"]
    ]
    if rows:
        note = "rms error in % of the range; jittered by 0.2 d; surface where the particles end, or half a spacing out."
        made.append(Table("A sphere that cools, R = 10 d", ["scheme", "number", "as it is", "shifted"], rows, note))
    rows = [
        [SCHEMES[name], f"{row['number']:.3g}", row["raw"], row["shifted"], row["highest"], row["lowest"]]
        for name in MELTING
        if f"stefan_{name}" in results
        for row in results[f"stefan_{name}"].values["rows"]
    ]
    if rows:
        note = "Largest error of the melted depth in %, from a quarter of the time on; wall 50, ice -10 deg C."
        heading = ["scheme", "number", "as it is", "shifted", "highest", "lowest"]
        made.append(Table("Stefan's problem with two phases, 40 spacings", heading, rows, note))
    rows = []
    for name in (*KEEPING, "one_sided"):
        own = [results[key].values for d in ("float64", "float32") if (key := f"ledger_{name}_{d}") in results]
        if own:
            rows.append([SCHEMES[name], *(f"{values['largest']:.1e}" for values in own), own[0]["melted"]])
    if rows:
        note = "Largest change of the heat over what could be moved; melted: share of the particles."
        made.append(Table("1,000 steps of melting ice", ["scheme", "float64", "float32", "melted"], rows, note))
    if "speed" in results:
        values = results["speed"].values
        rows = [
            [name, values["passes"].get(name, 1), f"{1e6 * seconds / values['particles']:.3f}", values["ratio"][name]]
            for name, seconds in values["seconds"].items()
        ]
        title = (
            f"A step of k dt/(rho c d^2) = 2, {values['particles']:,} particles, float32, {values['threads']} threads"
        )
        heading = ["scheme", "passes", "us per particle", "times a density pass"]
        made.append(Table(title, heading, rows, "Every step weighs all pairs anew, which is a pass of its own."))
    return made


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
        Picture("heat_orders", pictures.orders_data, pictures.orders, ("spacing", f"step_{BEST}", "spheres_20")),
        Picture(
            "heat_ledger", pictures.ledger_data, pictures.ledger,
            ("ledger_implicit_float64", "ledger_one_sided_float64"),
        ),
    ),
    tables=tables,
    claims=measures(claims),
    hard_cases=stability.CASES,
    maps=stability.MAPS,
    panels=accuracy.PANELS,
)  # fmt: skip
