"""Melting in fluid-solid interaction (Shao & Song 2017): scenes of figures 4 to 6, table 2, conservation, regions."""

from __future__ import annotations

from validation.cases.melting import pictures, runs
from validation.harness import Case, Options, Picture, Results, Run
from validation.tables import Table
from validation.verdicts import Bounds, Measurement

SHARES = {"figure_4": [0.9, 0.5, 0.1], "figure_5": [0.8, 0.5, 0.2], "figure_6": [0.8, 0.5, 0.2]}
UNTIL = {"figure_4": 4.0, "figure_5": 4.0, "figure_6": 4.0}
QUICK = 0.4
TITLES = {
    "figure_4": "Figure 4, an ice cube in warm water",
    "figure_5": "Figure 5, bodies of equal conductivity",
    "figure_6": "Figure 6, rabbits and ducks in two streams",
}


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    size = QUICK if options.quick else 1.0
    made = []
    for figure, shares in SHARES.items():
        parameters = {
            "figure": figure, "size": size, "backend": options.backend, "shares": shares, "until": UNTIL[figure],
        }  # fmt: skip
        made.append(Run(figure, runs.melt, parameters, estimate=8.0 if options.quick else 120.0))
    return made


def judge(results: Results) -> list[Measurement]:
    """Verdicts."""
    return []


def tables(results: Results) -> list[Table]:
    """Tables."""
    return []


CASE = Case(
    name="melting",
    title="melting in fluid-solid interaction: scenes, times, conservation, regions",
    runs=planned,
    judge=judge,
    pictures=(
        Picture(
            "melting_figure_4", pictures.stage_data("figure_4", TITLES["figure_4"]),
            pictures.stage_picture(-68.0, 16.0, False), ("figure_4",),
        ),
        Picture(
            "melting_figure_5", pictures.stage_data("figure_5", TITLES["figure_5"]),
            pictures.stage_picture(-68.0, 22.0, True), ("figure_5",),
        ),
        Picture(
            "melting_figure_6", pictures.stage_data("figure_6", TITLES["figure_6"]),
            pictures.stage_picture(-72.0, 24.0, True), ("figure_6",),
        ),
    ),
    tables=tables,
)  # fmt: skip
