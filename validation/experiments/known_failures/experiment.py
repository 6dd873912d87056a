"""What the hard cases look like that fail: states for pictures of docs/stability.md."""

from __future__ import annotations

from validation.checks import Checks
from validation.experiment import Experiment, Options, Picture, Results, Run
from validation.experiments.known_failures import pictures, runs


def planned(options: Options) -> list[Run]:
    """A run for each kind of failure; with --quick the short ones."""
    backend = {"backend": options.backend}
    reason = "takes a minute; run without --quick" if options.quick else ""
    return [
        Run("impact", runs.impact, backend, 5.0),
        Run("edge_wedge", runs.edge, {**backend, "what": "wedge"}, 3.0),
        Run("edge_level_plate", runs.edge, {**backend, "what": "level plate"}, 3.0),
        Run("upright_edges", runs.upright_edges, backend, 3.0),
        Run("sheet", runs.sheet, backend, 2.0),
        Run("filament", runs.drawn_in, backend, 40.0, reason),
        Run("rounding", runs.rounding, backend, 20.0, reason),
    ]


def checks(results: Results, check: Checks) -> None:
    """How many particles are wrong; shown."""
    for key, result in results.items():
        if "wrong" in result.values:
            check("wrong", result.values["wrong"], key, pictures.TITLES[key].replace("\n", " "))


EXPERIMENT = Experiment(
    name="known_failures",
    title="what the hard cases look like that fail",
    runs=planned,
    checks=checks,
    pictures=(Picture("known_failures", pictures.data, pictures.picture, tuple(pictures.TITLES)),),
)
