"""Scalar formula of one-way coupling: patent CN104318598A, the viscous force of P6."""

from refsim.compile import formula


@formula
def wall_viscosity_pair(wall_mass, density_i, wall_viscosity, laplacian):
    """P6 for one boundary particle: factor of v_b - v_i in the acceleration [1/s], mu Psi_b/rho_i^2 lap W_ib (E30).

    From F_ib = mu (m_i/rho_i) (Psi_b/rho_i) (v_b - v_i) lap W_ib, Psi_b = rho0 V_b; v_b = 0.
    """
    return wall_viscosity.coefficient * wall_mass / (density_i * density_i) * laplacian
