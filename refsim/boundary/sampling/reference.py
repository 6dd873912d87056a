"""Patent P2 to P4: particles on a surface, and how they are spread. Areas and places are those of facets.

P2: A = |(b - a) x (c - a)|/2 [m^2], with E25 g A/(pi r^2) particles by a running sum, at x = (1 - s) a + s ((1 - w) b
+ w c) [m] (`refsim.surface_energy.reference`).
"""

import math

import numpy as np

from refsim.surface_energy.reference import share


def repulsion(r, inverse_width):
    """P4: Omega = exp(-r^2/w^2) of particles r [m] apart, dimensionless; v = sum_l Omega (x - x_l)/|x - x_l|."""
    return np.exp(-(r**2) * inverse_width)


def direction(i, j, seed):
    """Unit vector e_ij = -e_ji of two particles at one place, even on the sphere; dimensionless."""
    low, high = min(i, j), max(i, j)
    z = 2 * share(low, high, 2 * int(seed)) - 1
    turn, away = 2 * math.pi * share(low, high, 2 * int(seed) + 1), math.sqrt(1 - z * z)
    return (1 if i < j else -1) * np.array([away * math.cos(turn), away * math.sin(turn), z])


def tangential(v, n):
    """P4 with E24: v_t = (I - n n^T) v, dimensionless."""
    return v - (v * n).sum(1)[:, None] * n


def held(move, longest):
    """P3, P4: x <- x + lambda r v_t - phi n; the first step [m], of at most the longest length."""
    length = np.linalg.norm(move, axis=1)[:, None]
    return np.where(length > longest, move * (longest / np.maximum(length, longest)), move)
