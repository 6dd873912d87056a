"""Surface detection of films and filaments: the fan scan with and without the second moment, against the exact cover.

The limit on the second moment was chosen on clouds of other seeds (1 to 4) and on the stored moments of the dam break.
"""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Results, Run
from validation.experiments.thin_features import runs
from validation.experiments.thin_features.shapes import FAMILIES
from validation.results import real

SEEDS = (21, 22, 23)
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
        kept = seeds[:1] if dim == 3 else seeds
        parameters = {"columns": columns, "depth": depth, "seeds": kept, "backend": options.backend}
        estimate = 120.0 if dim == 3 else 15.0 * len(kept)
        made.append(Run(f"splash_{dim}d", runs.splash, parameters, estimate=estimate, skip=skip))
    return made


def checks(results: Results, check: Checks) -> None:
    """The verdicts."""
    for key, result in results.items():
        family, score = result.values["family"], result.values["score"]
        words = f"{WORDS[family]}, {result.values['dim']}D"
        for normal in ("color", "corrected"):
            before, after = score[normal], score[f"{normal}_thin"]
            named = f"{words}, {runs.WORDS[normal]}"
            if family in THIN:
                check("thin_recall", after["recall"], f"{key}.{normal}", named)
            loss = real(before["precision"]) - real(after["precision"])
            rule = "precision_loss" if family in THICK else "precision_loss_thin"
            check(rule, loss, f"{key}.{normal}", named)


EXPERIMENT = Experiment(
    name="thin_features",
    title="surface detection of films and filaments: the fan scan with and without the second moment",
    runs=planned,
    checks=checks,
)
