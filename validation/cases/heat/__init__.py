"""Heat conduction: a cosine in a slab by every scheme, its error against the work, and who keeps the heat."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from validation.cases.heat import runs
from validation.harness import Case, Options, Picture, Results, Run
from validation.results import real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

SCHEMES = {
    "one_sided": "M(4), each particle by itself (R1)", "pair_exchange": "M(4), both of a pair (R3)",
    "single_pass": "single pass (NPX)", "implicit": "implicit (Chebyshev)",
    "conjugate_gradient": "conjugate gradients", "runge_kutta_legendre": "RKL2", "explicit": "explicit",
}  # fmt: skip
KEEPING = ("pair_exchange", "single_pass", "implicit", "conjugate_gradient", "runge_kutta_legendre")


def planned(options: Options) -> list[Run]:
    """One run for each scheme; all of them take seconds."""
    return [Run(f"slab_{name}", runs.slab, {"scheme": name}, estimate=4.0) for name in SCHEMES]


def found(results: Results) -> dict[str, list[Mapping[str, Any]]]:
    """Rows of each scheme that was run."""
    return {name: results[f"slab_{name}"].values["rows"] for name in SCHEMES if f"slab_{name}" in results}


def judge(results: Results) -> list[Measurement]:
    """Errors and drifts, and the bars of the recommended schemes."""
    bounds, made, rows = Bounds("heat"), [], found(results)
    for name, own in rows.items():
        for row in own:
            key, words = f"{name}_{row['number']:g}", f"{SCHEMES[name]}, {row['number']:g}"
            made.append(bounds.judge("slab_error", real(row["error"]), key, words))
        made.append(bounds.judge("drift", max(abs(real(row["drift"])) for row in own), name, SCHEMES[name]))
    for name, bar in (("implicit", "implicit_error"), ("runge_kutta_legendre", "legendre_error")):
        if name in rows:
            made.append(bounds.judge(bar, next(real(row["error"]) for row in rows[name] if row["number"] == 8)))
    keeping = [abs(real(row["drift"])) for name in KEEPING for row in rows.get(name, ())]
    if keeping:
        made.append(bounds.judge("conservative_drift", max(keeping)))
    return made


def tables(results: Results) -> list[Table]:
    """Error by scheme and step."""
    rows = [[SCHEMES[name], *(row["error"] for row in own)] for name, own in found(results).items()]
    heading = ["scheme", *(f"{number:g}" for number in runs.NUMBERS)]
    note = "rms error in % of the range, by k dt/(rho c d^2); half a cosine in 40 spacings, h = 2.5 d, float64."
    return [Table("A cosine in a slab", heading, rows, note)] if rows else []


def collect(results: Results) -> dict[str, Any]:
    """Error against passes."""
    return {"schemes": {SCHEMES[name]: own for name, own in found(results).items()}}


def draw(data: Mapping[str, Any]) -> Any:
    """Error over the passes for each unit of k dt/(rho c d^2)."""
    import matplotlib.pyplot as plt

    from validation import drawing as d

    figure, axis = plt.subplots(figsize=(6.4, 4.2))
    colours = iter((d.VERMILION, d.ORANGE, d.SKY, d.BLUE, d.PURPLE, d.GREEN, d.GREY))
    for name, rows in data["schemes"].items():
        colour = next(colours)
        shown = [(r["work"], r["error"], r["number"]) for r in rows if r["work"] and r["error"]]
        if shown:
            work, error, _ = zip(*shown)
            axis.loglog(work, error, "o-", color=colour, label=name)
            for w, e, n in shown:
                axis.annotate(f"{n:g}", (w, e), (4, 4), textcoords="offset points", fontsize=7, color=colour)
    axis.set_xlabel("passes over the neighbours for each k dt/(rho c d²) = 1")
    axis.set_ylabel("rms error [% of the range]")
    axis.set_title("A cosine in a slab: error against work")
    axis.grid(True, which="major")
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


CASE = Case(
    name="heat",
    title="conduction of heat: a cosine in a slab by every scheme, error against work, and who keeps the heat",
    runs=planned,
    judge=judge,
    pictures=(Picture("heat_schemes", collect, draw, ("slab_implicit", "slab_runge_kutta_legendre")),),
    tables=tables,
)
