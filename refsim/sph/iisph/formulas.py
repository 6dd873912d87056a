"""Scalar formulas of implicit incompressible SPH (Ihmsen et al. 2014), with s = dt (dt_previous + dt)/2 for dt^2."""

from refsim.backends.compile import formula


@formula
def diagonal(gradient_squared, pair_squares, density_i, square_step):
    """a_ii = sum_j m_j (d_ii - d_ji).grad W_ij = -(s/rho_i^2) (|sum_j m_j grad W_ij|^2 + m_i sum_j m_j |grad W_ij|^2).

    [kg/(m^dim Pa)], never positive; d_ii = -(s/rho_i^2) sum_j m_j grad W_ij, d_ji = (s m_i/rho_i^2) grad W_ij.
    """
    return -square_step / (density_i * density_i) * (gradient_squared + pair_squares)


@formula
def relaxed_pressure(pressure, missing, sums, diagonal, implicit, square_step):
    """p <- max(0, (1 - w) p + (w/a_ii) (rho0 - rho_adv - sums)) [Pa]; 0 where -a_ii is at most 1e-6 of the bulk's."""
    real = type(pressure)
    if -diagonal <= implicit.least_diagonal * square_step:
        return real(0)
    value = (real(1) - implicit.relaxation) * pressure + implicit.relaxation * (missing - sums) / diagonal
    if value < real(0):
        return real(0)
    return value
