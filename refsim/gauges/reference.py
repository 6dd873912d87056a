"""Sums over the liquid j at points i."""


def fill(i, j, ij):
    """sum_j V_j W_ij, V_j = m_j/rho_j; dimensionless."""
    return j.mass / j.density * ij.W


def flow(i, j, ij):
    """sum_j V_j v_j W_ij [m/s]."""
    return fill(i, j, ij) * j.velocity
