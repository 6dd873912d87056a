"""Scalar formulas of the continuum surface force, as reconstructed from Wang, Zhu & Yin 2019."""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import added, dot, scaled


@formula
def tangential_share(cosine, continuum):
    """1 - (1 - delta) (e_ij . n_i)^2, the part of a pair's direction along the surface; 1 in the plain reading.

    delta = 0.01 keeps the sum positive if all neighbours lie along the normal. Dimensionless.
    """
    real = type(cosine)
    if continuum.plain:
        return real(1)
    return real(1) - real(0.99) * cosine * cosine


@formula
def curvature(divergence, spread, continuum):
    """kappa = -f sum V_j (n_j - n_i).e_ij W' / (-sum V_j r s_ij W') [1/m], f = dim - 1 (dim in the plain reading)."""
    real = type(divergence)
    if spread == real(0):
        return real(0)
    return -continuum.factor * divergence / spread


@formula
def at_walls(n, w, filled, beside, beyond, both, wetting):
    """(n, its denominator) of liquid with walls; n = sum V grad W with walls as liquid, w of walls alone [1/m].

    dry = min(8 beyond/both, 1), where walls rise beyond the surface. n goes along w until n.w/|w| = cot(angle)
    |n across w|, by at most 2 |n across w| and dry |w|; walls fill (1 - dry) of `beside`.
    """
    real = type(filled)
    size = math.sqrt(dot(w, w))
    if size == real(0) or both == real(0):
        return n, filled
    dry = min(real(8) * beyond / both, real(1))
    along = dot(n, w) / size
    across = added(n, scaled(w, -along / size))
    tall = math.sqrt(dot(across, across))
    most = min(real(2) * tall, dry * size)
    change = max(min(wetting.cotangent * tall - along, most), -most)
    return added(n, scaled(w, change / size)), filled - dry * beside
