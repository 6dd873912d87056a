"""Solids given as meshes: distance, particles spread over them, and liquid that meets them (patent CN104318598A)."""

from __future__ import annotations

from validation.checks import Checks
from validation.claims import measures
from validation.experiment import Experiment, Options, Results, Run
from validation.experiments.boundary import accuracy, claims, flow, flow_stability, sampling, sampling_stability
from validation.tables import Table

PARTS = (sampling, flow)  # each with planned, checks, tables and PICTURES


def planned(options: Options) -> list[Run]:
    """The runs under the options."""
    return [run for part in PARTS for run in part.planned(options)]


def checks(results: Results, check: Checks) -> None:
    """The checks of both parts."""
    for part in PARTS:
        part.checks(results, check)


def tables(results: Results) -> list[Table]:
    """The tables of both parts."""
    return [table for part in PARTS for table in part.tables(results)]


EXPERIMENT = Experiment(
    name="boundary",
    title="meshes as boundaries: distance, particles, penetration, a tank at rest, pouring by tension",
    runs=planned,
    checks=checks,
    pictures=tuple(picture for part in PARTS for picture in part.PICTURES),
    tables=tables,
    claims=measures(claims),
    hard_cases=(*sampling_stability.hard_cases(), *flow_stability.hard_cases()),
    panels=accuracy.PANELS,
)
