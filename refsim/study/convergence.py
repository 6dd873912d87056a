"""Order, extrapolated value and uncertainty from values at several spacings.

Q(h) = Q0 + C h^p through the three finest values (Richardson extrapolation with an unknown order), and the grid
convergence index of Roache (1994): U = F |Q0 - Q1| around the finest value Q1.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LOWEST, HIGHEST = 0.5, 3.0  # orders outside of which three values show no convergence of a second-order method
TRUSTED = (0.9, 2.2)  # orders of a method between first and second order
SAFE, CAUTIOUS = 1.25, 3.0  # Roache's factors: for a trusted order, and for any other
SAME_ORDER = 0.5  # by which the orders of two triples of levels may differ


@dataclass(frozen=True)
class Convergence:
    """What several values of an observable say about its limit."""

    value: float  # Q0 where the values are in the asymptotic range, else that of the finest level
    uncertainty: float  # half the width of the band around `value`, in its unit
    order: float  # p, observed; NaN where no power law from LOWEST to HIGHEST goes through the values
    asymptotic: bool  # whether order and extrapolation can be used
    words: str  # why not, or how the uncertainty was found
    safety: float = CAUTIOUS  # factor F by which `uncertainty` exceeds the estimated error of the finest level
    scale: float = 0.0  # an error of 1, in the unit of `value`; 0 for |value|

    def bound(self, value: float) -> float:
        """Largest error that a level with this value is taken to have, relative to the scale: its grid convergence
        index, or its distance from the finest value and the uncertainty of that one.
        """
        if self.asymptotic:
            return self.safety * self.error(value)
        return self.error(value) + self.relative

    def error(self, value: float) -> float:
        """|Q - Q0| relative to the scale; infinite where that is zero and Q is not Q0."""
        return self._share(abs(value - self.value))

    @property
    def relative(self) -> float:
        """The uncertainty relative to the scale."""
        return self._share(self.uncertainty)

    def _share(self, off: float) -> float:
        scale = self.scale or abs(self.value)
        return off / scale if scale else (0.0 if off == 0 else math.inf)


@dataclass(frozen=True)
class Reference:
    """What a value is held against."""

    value: float
    scale: float  # an error of 1, in the value's unit
    uncertainty: float  # of the reference, relative to the scale
    words: str

    def error(self, value: Any) -> Any:
        """Relative error of a value, or of an array of them."""
        return abs(value - self.value) / self.scale


def observed_order(spacing: Sequence[float], value: Sequence[float]) -> float:
    """p of Q0 + C h^p through three values, the finest first; NaN where none fits (the values do not converge
    monotonically).
    """
    from scipy.optimize import brentq

    (h1, h2, h3), (q1, q2, q3) = spacing, value
    fine, coarse = q2 - q1, q3 - q2
    if fine == 0 or coarse / fine <= 0:
        return math.nan

    def misfit(p: float) -> float:  # rises with p; h1, h2, h3 rise
        a, b = (h2 / h1) ** p, (h3 / h1) ** p
        return (b - a) / (a - 1) - coarse / fine

    low, high = 1e-3, 40.0
    if misfit(low) > 0 or misfit(high) < 0:
        return math.nan
    return float(brentq(misfit, low, high, xtol=1e-12))


def converge(spacing: Sequence[float], value: Sequence[float]) -> Convergence:
    """What values at different spacings say; in any order. Values that are not finite must be left out.

    Raises ValueError for fewer than one value, or for equal spacings.
    """
    if len(spacing) != len(value) or not len(value) or len(set(spacing)) != len(spacing):
        raise ValueError("converge needs one value for each of some different spacings")
    order = np.argsort(spacing)
    h, q = [float(spacing[k]) for k in order], [float(value[k]) for k in order]
    spread = float(np.ptp(q))
    if len(q) < 3:
        reason = "fewer than three levels: no order can be observed"
        return Convergence(q[0], CAUTIOUS * spread if len(q) > 1 else math.nan, math.nan, False, reason)
    if spread == 0:
        return Convergence(q[0], 0.0, math.nan, False, "the same value at all levels")
    p = observed_order(h[:3], q[:3])
    doubt = _doubt(h, q, p)
    p = p if LOWEST <= p <= HIGHEST else math.nan
    if doubt:
        return Convergence(q[0], CAUTIOUS * float(np.ptp(q[:3])), p, False, f"not in the asymptotic range: {doubt}")
    limit = extrapolated(h[:2], q[:2], p)
    trusted = TRUSTED[0] <= p <= TRUSTED[1]
    off = abs(extrapolated(h[:2], q[:2], min(p, TRUSTED[1])) - q[0])
    factor = SAFE if trusted else CAUTIOUS
    why = "" if trusted else f", because the order is not between {TRUSTED[0]:g} and {TRUSTED[1]:g}"
    reason = f"Richardson extrapolation with the observed order {p:.2f}; factor {factor:g} of safety{why}"
    return Convergence(limit, factor * off, p, True, reason, factor)


def extrapolated(spacing: Sequence[float], value: Sequence[float], order: float) -> float:
    """Q0 from the two finest values, the finest first."""
    return value[0] + (value[0] - value[1]) / ((spacing[1] / spacing[0]) ** order - 1)


def _doubt(h: Sequence[float], q: Sequence[float], p: float) -> str:
    """Why the finest values cannot be extrapolated; "" where they can."""
    if math.isnan(p):
        fine, coarse = q[1] - q[0], q[2] - q[1]
        if fine * coarse < 0:
            return "the values alternate from level to level"
        return "the differences between levels do not shrink with the spacing"
    if not LOWEST <= p <= HIGHEST:
        return f"the differences between levels fall as no power of the spacing from {LOWEST:g} to {HIGHEST:g}"
    if len(q) > 3:
        before = observed_order(h[1:4], q[1:4])
        if math.isnan(before):
            return "the coarser three levels do not converge monotonically"
        if abs(before - p) > SAME_ORDER:
            return f"the orders of the finer and of the coarser three levels differ by more than {SAME_ORDER:g}"
    return ""
