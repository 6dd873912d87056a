"""The liquid, its walls, its list and its files: hard cases that have no paper of their own."""

from __future__ import annotations

from validation.experiment import Experiment
from validation.experiments.foundation.stability import CASES, MAPS

EXPERIMENT = Experiment(
    name="foundation", title="the liquid, its walls, its list and its files", hard_cases=CASES, maps=MAPS
)
