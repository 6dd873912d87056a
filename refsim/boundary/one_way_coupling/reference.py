"""Patent P6 with E30, and Adami, Hu & Adams 2012: the terms of one pair. Walls b have the mass Psi_b = rho0 V_b."""

from refsim.core.terms import maximum, where


def wall_viscous_force(i, b, ib, mu):
    """Patent P6 with E30, viscous part: a_i = sum_b mu Psi_b/rho_i^2 (v_b - v_i) lap W_ib [m/s^2]."""
    return mu * b.mass / (i.density * i.density) * ib.laplacian * (b.velocity - i.velocity)


def weight(i, j, ij):
    """sum_j W_ij [1/m^dim], i itself included."""
    return ij.W


def pressure_and_head(i, j, ij):
    """(27) p~_i = sum_j W_ij (p_j + rho_j g.x_ij) / sum_j W_ij; the first sum [Pa/m^dim]. g is `felt` at i."""
    return ij.W * (j.pressure + j.density * (ij.x @ i.felt))


def extrapolated_pressure_force(i, b, ib, s, rho0, clamp):
    """a_i = -s sum_b Psi_b p_b/rho_i^2 grad W_ib [m/s^2], p_b = p~_i - rho0 g.x_ib, at least 0 where clamped."""
    p_b = i.mean - rho0 * (ib.x @ i.felt)
    return -s * b.mass / (i.density * i.density) * where(clamp, maximum(p_b, 0), p_b) * ib.gradient
