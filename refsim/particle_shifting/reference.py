"""Equations of particle shifting after Sun et al. 2017: the term of one pair in the sum over j, or what follows."""

import numpy as np

from refsim.core.terms import Terms, clip, length, where


def filling_gradient(i, j, ij):
    """n_i = sum_j V_j grad W_ij [1/m], over walls too: inward at a surface, 0 inside."""
    return j.volume * ij.gradient


def concentration_gradient(i, j, ij, inverse):
    """(7) g_i = sum_j V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij [1/m], over walls too; `inverse` = 1/W(d)."""
    return j.volume * (1 + 0.2 * (ij.W * inverse) ** 4) * ij.gradient


def largest_speed(along, against):
    """v_max = |v_+ + v_-|/2 [m/s], of the largest velocities along and against each axis beyond any one of them."""
    return np.linalg.norm(along + against) / 2


def shift(i, length, longest):
    """(7) s_i = -A 2 h_s v_max dt g_i [m], `length` = A 2 h_s, `longest` = v_max dt."""
    return -length * longest * i.gradient


def beside_surface(i, s, least, whole):
    """s_i -= f (s_i.n) n [m], or f s_i where n_i is shorter than `least`; f from 1 where 0.97 is filled to 0."""
    n2 = i.normal @ i.normal
    pointed = length(i.normal) >= least
    across = where(pointed, (s @ i.normal) / where(pointed, n2, 1.0) * i.normal, s)
    return s - clip((1 - whole * i.filling) / 0.03, 0, 1) * across


def bounded(s, most):
    """s_i <- s_i min(1, most/|s_i|) [m]."""
    far = Terms(length(s).value > most)
    return where(far, most / where(far, length(s), 1.0) * s, s)
