"""Dong, Zhang & Chen 2016: the term of one pair in each sum."""

from refsim.sph.reference import number_density as number_density
from refsim.sph.reference import number_density_at_walls as number_density_at_walls
from refsim.sph.reference import wall_pressure_force as wall_pressure_force


def density(i, number):
    """D(3) rho_i = m_i sum_j W_ij [kg/m^dim], i itself included."""
    return i.mass * number


def pressure_force(i, j, ij):
    """D(4) a_i = -(1/m_i) sum_j (V_i^2 p_i + V_j^2 p_j) W'(r) e_ij [m/s^2], V = m/rho."""
    V_i, V_j = i.mass / i.density, j.mass / j.density
    return -(V_i * V_i * i.pressure + V_j * V_j * j.pressure) / i.mass * ij.gradient


def viscous_force(i, j, ij, mu):
    """D(5) a_i = (1/m_i) sum_j mu (V_i^2 + V_j^2) (v_i - v_j) W'(r)/r [m/s^2]."""
    V_i, V_j = i.mass / i.density, j.mass / j.density
    return mu * (V_i * V_i + V_j * V_j) / i.mass * ij.slope / ij.apart * (i.velocity - j.velocity)


def force_function(s, h, d0):
    """D(7) L(r)/k = (s^4 - (h-d0)^2 s^2)/(h^2 d0 (2h-d0)), s = h - r or 0 if r > h; dimensionless, > 0 repels."""
    return (s * s * s * s - (h - d0) ** 2 * (s * s)) / (h**2 * d0 * (2 * h - d0))


def molecular_force(i, j, ij, k, d0):
    """D(6) a_i = k sum_j m_j L(r)/k e_ij [m/s^2]."""
    return k * j.mass * force_function(ij.depth, ij.h, d0) * ij.e


def normal_correction(i, j, ij, lam, symmetric):
    """D(9) a_i = -lambda sum_j V_j (n_i - n_j) W_ij [m/s^2], V_j = 2 m_j/(rho_i + rho_j) (Dong E21) or m_j/rho_j."""
    V_j = j.mass / (0.5 * (i.density + j.density) if symmetric else j.density)
    return -lam * V_j * ij.W * (i.normal - j.normal)
