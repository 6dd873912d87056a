"""Solids given as meshes: liquid that falls on them, lies in them and is poured over them (patent CN104318598A)."""

from __future__ import annotations

from validation.cases.boundary import flow
from validation.harness import Case

CASE = Case(
    name="boundary",
    title="meshes as boundaries: penetration, a tank at rest, pouring by tension",
    runs=flow.planned,
    judge=flow.judge,
    pictures=flow.PICTURES,
    tables=flow.tables,
)
