"""Akinci et al. 2013: the term of one pair in each sum."""

import math

import numpy as np

from refsim.core.terms import Terms, where
from refsim.surface_normal.reference import normals_apart


def cohesion_function(r, h, dim):
    """C(r) = 32/(pi h^9) {(h-r)^3 r^3, r > h/2; 2 (h-r)^3 r^3 - h^6/64} [1/m^3]; h^8 in 2D [1/m^2]; > 0 attracts."""
    q = np.asarray(r, dtype=float) / h
    cubes = Terms((np.maximum(1 - q, 0) * q) ** 3)
    return where(q > 0.5, cubes, 2 * cubes - 1 / 64) * (32 / (math.pi * h**dim))


def adhesion_function(r, h, dim):
    """A(r) = 0.007/h^3.25 (-4 r^2/h + 6 r - 2 h)^(1/4), h/2 < r < h [1/m^3]; h^2.25 in 2D [1/m^2]."""
    q = Terms(np.asarray(r, dtype=float) / h)
    inside = (q > 0.5) & (q < 1)
    product = where(inside, (2 * q - 1) * (2 - 2 * q), 1.0)
    return where(inside, 0.007 / h**dim * product**0.25, 0.0)


def symmetric_factor(i, j, rest):
    """K_ij = 2 rho0/(rho_i + rho_j); dimensionless."""
    return 2 * rest / (i.density + j.density)


def cohesion(i, j, ij, gamma, rest):
    """a_i = -gamma sum_j K_ij m_j C(r) e_ij [m/s^2]."""
    return -gamma * symmetric_factor(i, j, rest) * j.mass * cohesion_function(ij.r.value, ij.h, ij.dim) * ij.e


def area(i, j, ij, eps, rest, along):
    """a_i = -eps sum_j K_ij (n_i - n_j) [m/s^2], or of the part along e_ij."""
    return -eps * symmetric_factor(i, j, rest) * normals_apart(i, j, ij, along)


def adhesion(i, b, ib, beta):
    """a_i = -beta sum_b Psi_b A(r) e_ib [m/s^2], Psi_b = rho0 V_b the mass of b."""
    return -beta * b.mass * adhesion_function(ib.r.value, ib.h, ib.dim) * ib.e
