"""Surface detection: decisions on one particle or one pair, which carry how far they are from flipping."""

import math

import numpy as np

from refsim.core.terms import Decision, Terms, least_eigenvalue, length, outer


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


def is_near(i, j, ij, h):
    """1 where |x_ij| < h, else 0; dimensionless."""
    return Terms(ij.r.value < h)


def weight(i, j, ij, h):
    """w_ij = 1 - (r/h)^2 for r < h, i itself included; dimensionless."""
    return Terms(np.maximum(1 - (ij.r.value / h) ** 2, 0))


def weighted_place(i, j, ij, h):
    """Mean place m_i - x_i = sum_j w_ij (x_j - x_i) / sum_j w_ij; the first sum [m]."""
    return -weight(i, j, ij, h) * ij.x


def second_moment(i, j, ij, h):
    """C_i = sum_j w_ij (x_j - m_i)(x_j - m_i)^T / sum_j w_ij; the first sum [m^2]."""
    apart = -ij.x - i.mean
    return weight(i, j, ij, h) * outer(apart, apart)


def thin(moment, dim, variance):
    """The least eigenvalue of C_i/h^2 <= the limit; a flag."""
    return least_eigenvalue(Terms(*(part[:, :dim, :dim] for part in moment), rank=2)) <= variance
