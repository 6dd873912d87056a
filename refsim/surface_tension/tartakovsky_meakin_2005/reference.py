"""Tartakovsky & Meakin 2005."""

import numpy as np

from refsim.core.terms import cos


def cohesion(i, j, ij, s):
    """a_i = (s/m_i) sum_j cos(3 pi r/(2 h)) e_ij [m/s^2]."""
    return s / i.mass * cos(1.5 * np.pi / ij.h * ij.r) * ij.e
