"""Statistics of work and precision: medians, Pareto front, observed order, and whether two reports differ.

Points are plain mappings with "error" and "seconds" (a median), as `validation.accuracy` makes them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

REPEATS = 5  # fewer are no statistics
SCATTER = 0.05  # robust standard deviation over the median, above which a time is called unstable
SPREAD = 1.5  # the slow end (90 %) over the fast end (10 %) of the repeats, above which it is, too
NORMAL = 1.4826  # standard deviation of a normal distribution over its median absolute deviation
SURE = 3.0  # standard deviations that a difference must exceed
LEAST_TIME = 0.05  # relative difference of two times that does not matter
LEAST_ERROR = 0.01  # the same of two errors
ORDERS = (0.05, 12.0)  # orders of convergence that are looked for


def middle(values: Sequence[float]) -> tuple[float, float]:
    """Median and median absolute deviation; NaN for no values."""
    if not len(values):
        return float("nan"), float("nan")
    median = float(np.median(values))
    return median, float(np.median(np.abs(np.asarray(values, dtype=float) - median)))


def instability(seconds: Sequence[float]) -> str:
    """Why a median of these times is not to be trusted; "" where it is."""
    if len(seconds) < REPEATS:
        return f"only {len(seconds)} of {REPEATS} repeats"
    median, deviation = middle(seconds)
    if not median > 0:
        return "no time passed"
    if NORMAL * deviation > SCATTER * median:
        return f"scatters by {100 * NORMAL * deviation / median:.0f} %"
    fast, slow = np.quantile(seconds, (0.1, 0.9))
    if slow > SPREAD * fast:
        return f"slow repeats take {slow / fast:.1f} times the fast ones"
    return ""


def unsettled(seconds: Sequence[float]) -> str:
    """Why a time is not advised: `instability`, or an interquartile range of SCATTER of the median or more; "" if
    neither."""
    why = instability(seconds)
    if why:
        return why
    low, median, high = np.quantile(seconds, (0.25, 0.5, 0.75))
    return "" if high - low < SCATTER * median else f"interquartile range {100 * (high - low) / median:.0f} %"


def pareto(points: Sequence[Mapping[str, Any]]) -> list[int]:
    """Numbers of the points that no other one beats in both error and seconds, from the fastest on.

    A point without a finite error or time is never on the front; of equals, the first one is.
    """
    order = sorted(
        (k for k, p in enumerate(points) if math.isfinite(p["error"]) and math.isfinite(p["seconds"])),
        key=lambda k: (points[k]["seconds"], points[k]["error"]),
    )
    front, best = [], math.inf
    for k in order:
        if points[k]["error"] < best:
            front.append(k)
            best = points[k]["error"]
    return front


@dataclass(frozen=True)
class Order:
    """Observed order of convergence.

    order, low, high   estimate and its interval; NaN where there is none
    asymptotic         whether the sequence behaves as a power of its size
    limit, uncertainty extrapolated observable and the grid convergence index of the finest; NaN with an exact reference
    words              all of it, as printed
    """

    order: float
    low: float
    high: float
    asymptotic: bool
    limit: float
    uncertainty: float
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
    return Order(float(fit.slope), float(low), float(high), fine, float("nan"), float("nan"), words)


def order_from_values(size: Sequence[float], value: Sequence[float], theory: float | None) -> Order:
    """Richardson's order from triples of grids, without an exact reference; the interval is the triples' range.

    The estimate is that of the three finest. In the asymptotic range: every triple converges monotonically and all
    orders lie within 1/2 of `theory`, or of the estimate where there is none. Grid convergence index after Celik et
    al. 2008 (doi:10.1115/1.2960953), safety factor 1.25, in the observable's unit.
    """
    pairs = sorted((s, v) for s, v in zip(size, value) if math.isfinite(v))
    if len(pairs) < 3:
        return _no_order(f"order not known: {len(pairs)} of 3 sizes")
    found = [_triple(pairs[k : k + 3]) for k in range(len(pairs) - 2)]
    known = [p for p in found if math.isfinite(p)]
    change = abs(pairs[1][1] - pairs[0][1])
    if not math.isfinite(found[0]):
        words = f"not in the asymptotic range (differences change sign, or grow); last refinement changes {change:.2g}"
        return _no_order(words)
    order, ratio = found[0], pairs[1][0] / pairs[0][0]
    step = (pairs[0][1] - pairs[1][1]) / (ratio**order - 1.0)
    limit, index = pairs[0][1] + step, 1.25 * abs(step)
    usual = found[0] if theory is None else theory
    fine = len(known) == len(found) and all(abs(p - usual) <= 0.5 for p in found)
    words = f"order {order:.2f}"
    if len(found) > 1:
        words += f" ({min(known):.2f} to {max(known):.2f} over {len(found)} triples"
        words += f", {len(found) - len(known)} without one)" if len(known) < len(found) else ")"
    words += f", {_theory(theory)}; grid convergence index {index:.2g}"
    if not fine:
        words += ": not in the asymptotic range"
    return Order(order, min(known), max(known), fine, limit, index, words)


def _theory(order: float | None) -> str:
    return "no theory" if order is None else f"theory {order:g}"


def _triple(pairs: Sequence[tuple[float, float]]) -> float:
    """Order p of three grids from fine to coarse with any ratios; NaN where they do not converge monotonically.

    The root of (h3^p - h2^p)/(h2^p - h1^p) = (v3 - v2)/(v2 - v1), which rises with p.
    """
    (h1, v1), (h2, v2), (h3, v3) = pairs
    fine, coarse = v2 - v1, v3 - v2
    if fine == 0.0 or coarse / fine <= 0.0:
        return float("nan")
    a, b = h1 / h2, h3 / h2

    def excess(p: float) -> float:
        return (b**p - 1.0) / (1.0 - a**p) - coarse / fine

    low, high = ORDERS
    if excess(low) > 0.0 or excess(high) < 0.0:
        return float("nan")
    from scipy.optimize import brentq

    return float(brentq(excess, low, high))


def _no_order(words: str) -> Order:
    nan = float("nan")
    return Order(nan, nan, nan, False, nan, nan, words)


# Two reports

SAME, BETTER, WORSE, UNSURE = "same", "better", "worse", "cannot tell"


def time_verdict(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Whether a median time has changed by more than the noise of both and by more than 5 %."""
    if any(p["unstable"] for p in (old, new)):
        return UNSURE
    return _verdict(old["seconds"], new["seconds"], old["mad"], new["mad"], LEAST_TIME)


def error_verdict(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Whether an error has changed by more than the noise of both and by more than 1 %."""
    failed = [not math.isfinite(p["error"]) for p in (old, new)]
    if any(failed):
        return SAME if all(failed) else WORSE if failed[1] else BETTER
    return _verdict(old["error"], new["error"], old["error_mad"], new["error_mad"], LEAST_ERROR)


def _verdict(old: float, new: float, old_mad: float, new_mad: float, least: float) -> str:
    noise = SURE * NORMAL * math.hypot(old_mad, new_mad)
    if abs(new - old) <= max(noise, least * abs(old)):
        return SAME
    return WORSE if new > old else BETTER
