"""Equations of particle shifting after Sun et al. 2017: the term of one pair in the sum over j, or what follows."""

import numpy as np

from refsim.core.terms import Terms, clip, length, where


def filling_gradient(i, j, ij):
    """n_i = sum_j V_j grad W_ij [1/m], over walls too: inward at a surface, 0 inside."""
    return j.volume * ij.gradient


def concentration_gradient(i, j, ij, inverse):
    """(7) g_i = sum_j V_j (1 + 0.2 (W_ij/W(d))^4) grad W_ij [1/m], over walls too; `inverse` = 1/W(d)."""
    return j.volume * (1 + 0.2 * (ij.W * inverse) ** 4) * ij.gradient


def largest_step(along, against, dt, farthest):
    """min(v_max dt, `farthest`) [m], v_max = |v_+ + v_-|/2 of the largest velocities along and against each axis."""
    return min(np.linalg.norm(along + against) / 2 * dt, farthest)


def shift(g, length):
    """(7) s_i/(v_max dt) = -A 2 h_s g_i [-], `length` = A 2 h_s."""
    return -length * g


def beside_surface(g, n, filling, least, whole, outer, within):
    """g_i - f n_i - f' (e.n) n/n^2 [1/m], e = g_i - n_i, or f' e where n_i is shorter than `least`; f from 1 where 0.97
    is filled to 0 at 1, f' from 1 at `outer` to 0 at `within`."""
    uneven = g - n
    pointed = length(n) >= least
    n2 = where(pointed, n @ n, 1.0)
    across = where(pointed, (uneven @ n) / n2 * n, uneven)
    near = clip((within - whole * filling) / (within - outer), 0, 1)
    return g - clip((1 - whole * filling) / 0.03, 0, 1) * n - near * across


def bounded(s, most):
    """s_i <- s_i min(1, most/|s_i|) [-]."""
    far = Terms(length(s).value > most)
    return where(far, most / where(far, length(s), 1.0) * s, s)
