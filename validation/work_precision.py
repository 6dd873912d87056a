"""Observed order of convergence."""

import math
from collections.abc import Sequence

import numpy as np


def observed_order(size: Sequence[float], error: Sequence[float]) -> float:
    """Slope of log error against log size, by least squares; NaN for fewer than three sizes with an error above 0."""
    pairs = [(s, e) for s, e in zip(size, error) if math.isfinite(e) and e > 0]
    return float(np.polyfit(*np.log(pairs).T, 1)[0]) if len(pairs) >= 3 else math.nan
