"""Surface detection: decisions on one particle or one pair, which carry how far they are from flipping."""

import math

import numpy as np

from refsim.core.terms import Decision, Terms, length


def sparse(i, limit):
    """J(12) delta_i <= lambda delta0; a flag."""
    return i.number <= limit


def asymmetric(i, limit):
    """Jiang & Zhu E23: |sum_j W_ij x_ij| >= the limit; a flag."""
    return i.asymmetry >= limit


def axis(i):
    """a_i = -n_i/|n_i|, 0 without a normal; dimensionless."""
    size = length(i.normal).value
    return Terms(-i.normal.value / np.where(size > 0, size, 1.0)[:, None], rank=1)


def directed(i, smallest):
    """Jiang & Zhu E20: |n_i| > the smallest normal, so that a_i = -n_i/|n_i| is known; a flag."""
    return length(i.normal) > smallest


def in_region(i, j, ij, s, printed):
    """J(13): j is in the region of i where |x_ij| >= sqrt2 s and |x_j - x_i - s a_i| < s, or in a cone; a flag.

    The cone: |x_ij| < sqrt2 s and a_i.(x_j - x_i) > sqrt(1/2) |x_ij| (Jiang & Zhu E5: printed "<"). Where both lines
    agree, the distance sqrt2 s between them does not matter.
    """
    beyond = ij.r >= math.sqrt(2) * s
    ball = length(-ij.x - s * i.axis) < s
    cosine = -(ij.e @ i.axis)
    there = Decision(np.where(ij.r.value > 0, 1.0, -1.0))
    cone = (cosine < math.sqrt(0.5)) & there if printed else cosine > math.sqrt(0.5)
    return (beyond & ball) | (~beyond & cone) | (ball & cone)


def near(i, j, ij, h):
    """|x_ij| < h; a flag."""
    return ij.r < h
