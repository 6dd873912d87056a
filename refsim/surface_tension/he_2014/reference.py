"""He et al. 2014: the term of one pair in each sum."""

from refsim.surface_normal.reference import filled as color
from refsim.surface_normal.reference import wall_filled as wall_color

__all__ = ["air_pressure", "color", "color_gradient", "gradient_energy", "wall_color"]


def color_gradient(i, j, ij):
    """grad c_i = (1/c_i) sum_j V_j c_j grad W_ij; the sum [1/m]."""
    return j.mass / j.density * j.color * ij.gradient


def gradient_energy(i, j, ij, kappa):
    """a_i = (kappa/(4 rho_i)) sum_j V_j (|grad c_i|^2 + |grad c_j|^2) grad W_ij [m/s^2]."""
    return 0.25 * kappa * j.mass / j.density / i.density * (i.squared + j.squared) * ij.gradient


def air_pressure(i, j, ij, p_atm):
    """a_i = (p_atm/rho_i) sum_j V_j grad W_ij [m/s^2]."""
    return p_atm * j.mass / j.density / i.density * ij.gradient
