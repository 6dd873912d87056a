"""Becker & Teschner 2007."""

import math

import numpy as np

from refsim.core.terms import Terms


def attraction_function(r, h, dim, least_distance):
    """w = W(max(r, d), h) [1/m^dim] inside the support, 0 beyond, with the cubic spline W."""
    r = np.asarray(r, dtype=float)
    q = np.maximum(r, least_distance) / h
    norm = 40 / (7 * math.pi * h**2) if dim == 2 else 8 / (math.pi * h**3)
    w = norm * np.where(q <= 0.5, 6 * (q**3 - q**2) + 1, 2 * (1 - q) ** 3)
    return np.where((r < h) & (q < 1), w, 0.0)


def cohesion(i, j, ij, kappa, least_q):
    """a_i = -kappa sum_j 2 m_j/(m_i + m_j) W(max(r, d)) x_ij [m/s^2]; printed (kappa/m_i) m_j, for equal masses."""
    W = Terms(attraction_function(ij.r.value, ij.h, ij.dim, least_q * ij.h))
    return -kappa * 2 * j.mass / (i.mass + j.mass) * W * ij.x
