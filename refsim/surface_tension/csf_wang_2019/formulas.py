"""Scalar formulas of the continuum surface force, as reconstructed from Wang, Zhu & Yin 2019."""

from refsim.backends.compile import formula


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
