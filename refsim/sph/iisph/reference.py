"""Implicit incompressible SPH (Ihmsen et al. 2014): the terms of one pair, or what follows from the sums.

Walls b are particles of mass m_b = rho0 V_b at rest; square is t dt, the kick times the drift.
"""

from refsim.core.terms import maximum
from refsim.sph.reference import kicked as kicked


def gradients(i, j, ij):
    """sum_j m_j grad W_ij [kg/m^(dim+1)]."""
    return j.mass * ij.gradient


def squares(i, j, ij):
    """sum_j m_j |grad W_ij|^2 [kg/m^(2 dim+2)]."""
    return j.mass * (ij.gradient @ ij.gradient)


def compression(i, j, ij):
    """rho_adv = rho_i + dt sum_j m_j (v_i - v_j).grad W_ij, v with the kick t a; the sum [kg/(m^dim s)]."""
    return j.mass * ((i.velocity - j.velocity) @ ij.gradient)


def own_displacement(i, total, square):
    """d_ii = -(t dt/rho_i^2) sum_j m_j grad W_ij [m/Pa]."""
    return -square / (i.density * i.density) * total


def diagonal(i, total, squares, square):
    """a_ii = -(t dt/rho_i^2) (|sum_j m_j grad W_ij|^2 + m_i sum_j m_j |grad W_ij|^2) [kg/(m^dim Pa)]."""
    return -square / (i.density * i.density) * (total @ total + i.mass * squares)


def displacement(i, j, ij, square):
    """s_i = sum_j d_ij p_j = -t dt sum_j (m_j p_j/rho_j^2) grad W_ij [m]."""
    return -square * j.mass * j.pressure / (j.density * j.density) * ij.gradient


def moved(i, j, ij, square):
    """L_i = sum_j m_j (s_i - d_jj p_j - s_j + d_ji p_i).grad W_ij [kg/m^dim], d_ji = t dt m_i/rho_i^2 grad W_ij."""
    back = square * i.mass * i.pressure / (i.density * i.density) * ij.gradient
    return j.mass * ((i.moved - j.own * j.pressure - j.moved + back) @ ij.gradient)


def moved_at_walls(i, b, ib):
    """L_i += sum_b m_b s_i.grad W_ib [kg/m^dim]."""
    return b.mass * (i.moved @ ib.gradient)


def relaxed(i, moved, diagonal, rest, omega):
    """p <- max(0, (1 - w) p + (w/a_ii) (rho0 - rho_adv - L_i)) [Pa]."""
    return maximum((1 - omega) * i.pressure + omega * (rest - i.advected - moved) / diagonal, 0)


def density_error(i, moved, rest):
    """max(0, rho_adv + a_ii p_i + L_i - rho0) = the compression that is left [kg/m^dim]."""
    return maximum(i.advected + i.diagonal * i.pressure + moved - rest, 0)


def pressure_force(i, j, ij):
    """a_i = -sum_j m_j (p_i/rho_i^2 + p_j/rho_j^2) grad W_ij [m/s^2]."""
    both = i.pressure / (i.density * i.density) + j.pressure / (j.density * j.density)
    return -j.mass * both * ij.gradient


def wall_pressure_force(i, b, ib):
    """a_i = -sum_b m_b p_i/rho_i^2 grad W_ib [m/s^2]."""
    return -b.mass * i.pressure / (i.density * i.density) * ib.gradient
