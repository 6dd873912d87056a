"""The liquid, its walls, its list and its files: hard cases that have no paper of their own."""

from __future__ import annotations

from validation.experiment import Experiment
from validation.experiments.foundation import stability

EXPERIMENT = Experiment(
    name="foundation",
    title="the liquid, its walls, its list and its files",
    trials=vars(stability),
    maps=stability.MAPS,
)
