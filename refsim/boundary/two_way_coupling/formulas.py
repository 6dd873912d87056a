"""Scalar formulas of two-way coupling: Shao & Song 2017, equations (1) to (3)."""

from refsim.backends.compile import formula


@formula
def relative_contribution(solid_sum, coupling):
    """Weight of (1): phi_k = V_k/V_min, V_k = 1/sum_k' W_kk' (M4); dimensionless, `solid_sum` in [1/m^dim]."""
    real = type(solid_sum)
    return real(1) / (solid_sum * coupling.least_volume)


@formula
def tait_pressure(density, rest_density, coupling):
    """Tait: p_i = (rho0_i c^2/g) ((rho_i/rho0_i)^g - 1) [Pa], zero where that is negative."""
    real = type(density)
    ratio = density / rest_density
    power = ratio
    for _ in range(1, coupling.exponent):
        power *= ratio
    pressure = rest_density * coupling.stiffness * (power - real(1))
    if pressure < real(0):  # not max(), which on a GPU passes over what is no number
        return real(0)
    return pressure


@formula
def pressure_pair(push_i, push_j, weight_i, weight_j, slope):
    """(2): factor of e_ij in F_ij = -(V_i^2 p_i phi_j + V_j^2 p_j phi_i) W' [N], phi = 1 in the liquid (M1, M2).

    push = V^2 p [N m^(dim+1)], zero for solids, so that each phase is pushed by the liquid's pressure alone.
    """
    return -(push_i * weight_j + push_j * weight_i) * slope


@formula
def weighted_pressure(pressure_i, pressure_j, density_i, density_j):
    """Hu & Adams 2007: one pressure of a pair [Pa], p_ij = (rho_j p_i + rho_i p_j)/(rho_i + rho_j)."""
    return (density_j * pressure_i + density_i * pressure_j) / (density_i + density_j)


@formula
def viscosity_pair(both, viscosity, laplacian):
    """(3): factor of v_j - v_i in F_ij = mu V V phi lap W [N s/m], `both` = V V phi in [m^(2 dim)] (M3)."""
    return viscosity.coefficient * both * laplacian


@formula
def wall_pressure_pair(wall_mass, pressure_i, density_i, slope):
    """(2) at a wall, whose m_i phi_b = Psi_b: factor of e_ib in the acceleration, -Psi_b p_i/rho_i^2 W' [m/s^2]."""
    return -wall_mass * pressure_i / (density_i * density_i) * slope
