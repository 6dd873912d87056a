"""Solids given as meshes: distance, particles spread over them, and liquid that meets them (patent CN104318598A)."""

from __future__ import annotations

from validation.cases.boundary import flow, sampling
from validation.harness import Case, Options, Results, Run
from validation.tables import Table
from validation.verdicts import Measurement

PARTS = (sampling, flow)  # each with planned, judge, tables and PICTURES


def _planned(options: Options) -> list[Run]:
    return [run for part in PARTS for run in part.planned(options)]


def _judge(results: Results) -> list[Measurement]:
    return [measurement for part in PARTS for measurement in part.judge(results)]


def _tables(results: Results) -> list[Table]:
    return [table for part in PARTS for table in part.tables(results)]


CASE = Case(
    name="boundary",
    title="meshes as boundaries: distance, particles, penetration, a tank at rest, pouring by tension",
    runs=_planned,
    judge=_judge,
    pictures=tuple(picture for part in PARTS for picture in part.PICTURES),
    tables=_tables,
)
