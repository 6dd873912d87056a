"""Surface detection of films and filaments: the fan scan with and without the second moment, against the exact cover.

The limit on the second moment was chosen on clouds of seed 1 and on the stored moments of the dam break; the seeds
here are others.
"""

from __future__ import annotations

from typing import Any

from validation.cases.thin_features import runs
from validation.cases.thin_features.shapes import FAMILIES
from validation.harness import Case, Options, Results, Run
from validation.results import real
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

SEEDS = (11, 12, 13)
THIN = ("films", "filaments")
THICK = ("three_layers", "bulk", "tanks", "splash")
WORDS = {**{name: words for name, (words, _) in FAMILIES.items()}, "splash": "splash of a dam break"}


def planned(options: Options) -> list[Run]:
    """Every family in 2D and 3D, three seeds, and the splash; with --quick one seed, and the splash in 2D only."""
    seeds = list(SEEDS[:1] if options.quick else SEEDS)
    made = []
    for dim in (2, 3):
        for family in FAMILIES:
            parameters = {"family": family, "dim": dim, "seeds": seeds, "backend": options.backend}
            made.append(Run(f"{family}_{dim}d", runs.clouds, parameters, estimate=1.5 * (dim - 1) * len(seeds)))
    reason = "in 3D it takes minutes; run without --quick" if options.quick else ""
    for dim, columns, depth, skip in ((2, 40, 1, ""), (3, 16, 16, reason)):
        parameters = {"columns": columns, "depth": depth, "seeds": seeds[: 4 - dim], "backend": options.backend}
        made.append(Run(f"splash_{dim}d", runs.splash, parameters, estimate=60.0 * (dim - 1), skip=skip))
    return made


def judge(results: Results) -> list[Measurement]:
    """The verdicts."""
    bounds, made = Bounds("thin_features"), []
    for key, result in results.items():
        family, score = result.values["family"], result.values["score"]
        words = f"{WORDS[family]}, {result.values['dim']}D"
        for normal in ("color", "corrected"):
            before, after = score[normal], score[f"{normal}_thin"]
            named = f"{words}, {runs.WORDS[normal]}"
            if family in THIN:
                made.append(bounds.judge("thin_recall", real(after["recall"]), f"{key}.{normal}", named))
            loss = real(before["precision"]) - real(after["precision"])
            rule = "precision_loss" if family in THICK else "precision_loss_thin"
            made.append(bounds.judge(rule, loss, f"{key}.{normal}", named))
    return made


def tables(results: Results) -> list[Table]:
    """Precision and recall of every detector on every family."""
    rows: list[list[Any]] = []
    for result in results.values():
        values = result.values
        cells = [
            f"{real(values['score'][name]['precision']):.3f} {real(values['score'][name]['recall']):.3f}"
            for name in runs.DETECTORS
        ]
        rows.append([WORDS[values["family"]], f"{values['dim']}D", values["particles"], *cells])
    note = (
        f"Precision and recall against the exact cover, radius {runs.TRUTH_RADIUS:g} spacings; h = {runs.SUPPORT:g} d."
    )
    heading = ["cloud", "", "particles", *runs.WORDS.values()]
    return [Table("Thin features: two steps, precision and recall", heading, rows, note)] if rows else []


CASE = Case(
    name="thin_features",
    title="surface detection of films and filaments: the fan scan with and without the second moment",
    runs=planned,
    judge=judge,
    tables=tables,
)
