"""Viscous forces, the term of one pair of each."""

from refsim.core.terms import minimum

SAFETY = 0.01  # of h_s^2 beside r^2


def approach(i, j, ij, h):
    """Monaghan 1992: mu_ij = h_s v_ij.x_ij/(r^2 + 0.01 h_s^2) [m/s] where v_ij.x_ij < 0, else 0."""
    return h * minimum((i.velocity - j.velocity) @ ij.x, 0) / (ij.r * ij.r + SAFETY * h * h)


def artificial(i, j, ij, alpha, beta, c, h):
    """Monaghan 1992: a_i = -sum_j m_j (beta mu_ij^2 - alpha c mu_ij)/rho_ij grad W_ij [m/s^2], rho_ij the mean."""
    mu = approach(i, j, ij, h)
    return -j.mass * (beta * mu * mu - alpha * c * mu) / (0.5 * (i.density + j.density)) * ij.gradient


def laminar(i, j, ij, mu, h):
    """Morris et al. 1997: a_i = sum_j m_j 2 mu/(rho_i rho_j) x_ij.grad W_ij/(r^2 + 0.01 h_s^2) (v_i - v_j) [m/s^2]."""
    along = (ij.x @ ij.gradient) / (ij.r * ij.r + SAFETY * h * h)
    return 2 * mu * j.mass / j.density / i.density * along * (i.velocity - j.velocity)
