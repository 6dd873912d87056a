"""Observed order of convergence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Order:
    """Observed order of convergence.

    order, low, high   estimate and its interval; NaN where there is none
    asymptotic         whether the sequence behaves as a power of its size
    words              all of it, as printed
    """

    order: float
    low: float
    high: float
    asymptotic: bool
    words: str


def order_from_errors(size: Sequence[float], error: Sequence[float], theory: float | None) -> Order:
    """Slope of log error against log size, by least squares, with its 95 % interval.

    In the asymptotic range: errors fall with every refinement, the interval is at most 1 wide, and `theory`, where
    there is one, lies in it or within 1/2 of the estimate. Needs three sizes.
    """
    pairs = sorted((s, e) for s, e in zip(size, error) if math.isfinite(e) and e > 0)
    if len(pairs) < 3:
        return _no_order(f"order not known: {len(pairs)} of 3 sizes")
    from scipy import stats  # takes a second to load

    s, e = np.array(pairs).T
    fit = stats.linregress(np.log(s), np.log(e))
    reach = float(stats.t.ppf(0.975, len(s) - 2) * fit.stderr)
    low, high = fit.slope - reach, fit.slope + reach
    falls = bool((np.diff(e) > 0).all())
    near = theory is None or low <= theory <= high or abs(fit.slope - theory) <= 0.5
    fine = falls and high - low <= 1.0 and near
    words = f"order {fit.slope:.2f} (95 %: {low:.2f} to {high:.2f}; {_theory(theory)}) over {len(s)} sizes"
    if not fine:
        why = "errors do not fall with every refinement" if not falls else "too uncertain, or far from theory"
        words += f": not in the asymptotic range ({why})"
    return Order(float(fit.slope), float(low), float(high), fine, words)


def _theory(order: float | None) -> str:
    return "no theory" if order is None else f"theory {order:g}"


def _no_order(words: str) -> Order:
    nan = float("nan")
    return Order(nan, nan, nan, False, words)
