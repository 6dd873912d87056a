"""Wang, Zhu & Yin 2019, reconstructed: the term of one pair in each sum, or what follows from the sums."""

import numpy as np

from refsim.core.terms import Terms, clip, length, maximum, minimum
from refsim.surface_normal.reference import filled as filled
from refsim.surface_normal.reference import wall_filled as wall_filled


def normal(i, j, ij):
    """n_i = sum_j V_j grad W_ij / sum_k V_k W_ik; the first sum [1/m]."""
    return j.mass / j.density * ij.gradient


def wall_normal(i, b, ib):
    """sum_b V_b grad W_ib of walls, w_i [1/m]; both sums are n_i with walls as liquid."""
    return b.volume * ib.gradient


def beyond(i, b, ib, both=False):
    """B_i = sum_b V_b W_ib max(n_i.x_ib, 0), walls on the side from which n_i points; of both sides A_i [-]."""
    height = i.inward @ ib.x
    return b.volume * ib.W * maximum(height, -height if both else 0)


def turned(n, w, dry, cotangent):
    """n_i turned to the contact angle: n_i + w^ c_i with w^ = w_i/|w_i| and c_i = |n_i across w^| cot(angle) - n_i.w^,
    at most 2 |n_i across w^| and dry_i |w_i| in size, where dry_i = min(8 B_i/A_i, 1) [1/m]."""
    size = length(w)
    unit = Terms(w.value / np.where(size.value > 0, size.value, 1)[..., None], rank=1)
    along = n @ unit
    across = length(n - along * unit)
    most = minimum(2 * across, dry * size)
    return n + clip(cotangent * across - along, -most, most) * unit


def divergence(i, j, ij):
    """kappa_i = -f sum_j V_j (n^_j - n^_i).e_ij W' / ..., n^ = n/|n| of active j; this sum [1/m]."""
    return j.active * j.mass / j.density * ij.slope * ((j.unit - i.unit) @ ij.e)


def renormalisation(i, j, ij, plain):
    """... / (-sum_j V_j r s_ij W'), s_ij = 1 - 0.99 (e_ij.n^_i)^2, f = dim - 1; plain 1 and f = dim; dimensionless."""
    cosine = i.unit @ ij.e
    s = 1.0 if plain else 1 - 0.99 * cosine * cosine
    return -j.active * j.mass / j.density * ij.slope * ij.r * s


def normal_force(i, sigma, slope):
    """rho_i a_i/c = sigma_i kappa_i n_i [N/m^3], sigma_i = sigma + slope.x_i."""
    return (sigma + i.position @ slope) * i.curvature * i.normal


def tension_rise(i, j, ij, slope):
    """g_i = sum_j V_j (sigma_j - sigma_i) grad W_ij [N/m^2]."""
    return -j.mass / j.density * (ij.x @ slope) * ij.gradient


def tangential_force(i, g):
    """rho_i a_i/c = |n_i| (g_i - (g_i.n^_i) n^_i) [N/m^3]."""
    return length(i.normal) * (g - (g @ i.unit) * i.unit)
