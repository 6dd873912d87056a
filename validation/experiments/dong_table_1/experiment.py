"""Dong, Zhang & Chen 2016, table 1: seconds per frame of Dong's model, the plain pair force and the continuum force.

The paper's numbers are lost. It times its cube and a scene called oil drops dissolving into each other. That a second
liquid surrounds them is an assumption; here the drops are of one liquid.
"""

from __future__ import annotations

import statistics

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.dong import runs
from validation.experiments.dong import scene as scenes
from validation.experiments.dong_table_1 import pictures

TURNS = (1, 2, 3)
CASES = {"droplet": "the cube of 4,913", "oil": "twelve drops of oil, 500 each"}


def key_of(case: str, model: str, turn: int) -> str:
    """Key of a run."""
    return f"{case}_{model}_{turn}"


def planned(options: Options) -> list[Run]:
    """Both scenes under the three models, in turn, so that a disturbance does not fall on one model alone."""
    reason = "a timing: wants a quiet machine; run without --quick" if options.quick else ""
    made = []
    for turn in TURNS:
        for case in CASES:
            for model in scenes.MODELS:
                parameters = {"model": model, "case": case, "backend": options.backend, "turn": turn}
                made.append(Run(key_of(case, model, turn), runs.seconds_per_frame, parameters, 3.0, reason, timed=True))
    return made


NEEDS = tuple(key_of(case, model, turn) for turn in TURNS for case in CASES for model in scenes.MODELS)


def per_frame(results: Results, case: str, model: str) -> list[float]:
    """Seconds of a frame, turn by turn; empty without all turns."""
    keys = [key_of(case, model, turn) for turn in TURNS]
    return [runs.per_frame(results[key].values) for key in keys] if set(keys) <= set(results) else []


def checks(results: Results, check: Checks) -> None:
    """Dong's time over those of the two others, the median of the turns; shown, since claims.toml judges it."""
    for case, words in CASES.items():
        own = per_frame(results, case, "dong")
        for rival in ("iif", "csf"):
            its = per_frame(results, case, rival)
            if own and its:
                share = statistics.median(a / b for a, b in zip(own, its, strict=True))
                check(f"frame_over_{rival}", share, case, words)


EXPERIMENT = Experiment(
    name="dong_table_1",
    title="Dong 2016, table 1: seconds per frame beside the plain pair force and the continuum force",
    runs=planned,
    checks=checks,
    pictures=(Picture("dong_table_1", pictures.data, pictures.picture, NEEDS),),
)
