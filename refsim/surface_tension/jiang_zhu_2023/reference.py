"""Jiang & Zhu 2023: the term of one pair in each sum, or what follows from the sums."""

import numpy as np

from refsim.core.terms import Terms, clip, length, maximum
from refsim.sph.reference import summed_density as summed_density
from refsim.surface_normal.reference import filled as filled
from refsim.surface_normal.reference import normals_apart

INNER = 0.8  # the repulsive kernel's support, as a share of h
MODES = ("soft", "all", "one_sided", "either", "both")


def wall_filled(i, b, ib):
    """J(15) over walls of mass rho0 V_b, sum_b (m_b/rho_i) W_ib; dimensionless."""
    return b.mass / i.density * ib.W


def corrected_density(summed, filled):
    """J(14) rho*_i = sum_j m_j W*_ij, J(15) W*_ij = W_ij / sum_k (m_k/rho_k) W_ik [kg/m^dim]; one pass (E8)."""
    return summed / filled


def soft_weight(normal, lower, upper):
    """Jiang & Zhu E9: w = 3 t^2 - 2 t^3, t = (|n| - lower)/(upper - lower) between 0 and 1; dimensionless."""
    t = clip((length(normal) - lower) / (upper - lower), 0, 1)
    return t * t * (3 - 2 * t)


def share(i, j, mode):
    """Jiang & Zhu E9: s_ij = the share of a pair force on i, by weights or marks of the surface; dimensionless."""
    if MODES[mode] == "soft":
        return 0.5 * (i.weight + j.weight)
    a, b = i.surface, j.surface
    return {"all": 1.0, "one_sided": a, "either": maximum(a, b), "both": a * b}[MODES[mode]]


def poly6(r, h, dim):
    """Poly6 kernel W(r, h) = A (1 - r^2/h^2)^3 [1/m^dim], A = 4/(pi h^2) in 2D and 315/(64 pi h^3) in 3D."""
    amplitude = 4 / (np.pi * h**2) if dim == 2 else 315 / (64 * np.pi * h**3)
    return Terms(amplitude * np.maximum(1 - (r.value / h) ** 2, 0) ** 3)


def cohesion(i, j, ij, gamma, alpha, beta, mode):
    """J(16) a_i = gamma sum_j s_ij m_j C(r) e_ij [m/s^2] (Jiang & Zhu E4).

    J(17) C = alpha W_poly6(r, 0.8 h) - beta W_poly6(r, h).
    """
    C = alpha * poly6(ij.r, INNER * ij.h, ij.dim) - beta * poly6(ij.r, ij.h, ij.dim)
    return gamma * share(i, j, mode) * j.mass * C * ij.e


def area(i, j, ij, eps, along, mode):
    """J(21) a_i = -eps sum_j s_ij m_j/(rho_i rho_j) (n*_i - n*_j) [m/s^2], or of the part along e_ij."""
    return -eps * share(i, j, mode) * j.mass / (i.density * j.density) * normals_apart(i, j, ij, along)


def simple_area(i, j, ij, eps, along, mode):
    """J(18) a_i = -eps' sum_j s_ij (n_i - n_j) [m/s^2], or of the part along e_ij."""
    return -eps * share(i, j, mode) * normals_apart(i, j, ij, along)
