"""Runs of the models: the droplet's cube to a ball."""

from __future__ import annotations

import numpy as np

from validation.cases.droplet.runs import CALM, relaxed
from validation.cases.models.scene import MODELS
from validation.results import Result, floats
from validation.running import Context


def relax(context: Context, model: str, shape: str, count: int, backend: str) -> Result:
    """From a cube to rest under one model; also when it came to rest, round or not.

    At rest from: the first sample from which on the kinetic energy stays below 1e-3 of its peak.
    """
    chosen = MODELS[model]
    result = relaxed(context, chosen.words, chosen.changes, shape, count, backend)
    values = dict(result.values)
    energy = floats(values["series"]["kinetic_energy"])
    busy = np.flatnonzero(~(energy <= CALM * energy.max()))
    first = int(busy.max(initial=-1)) + 1
    still = not values["stopped"] and first < len(energy)
    values["rest"] = {k: values["series"][k][first] for k in ("time", "wall", "steps")} if still else None
    return Result(values, result.arrays)
