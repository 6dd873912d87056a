"""Scalar formulas of two-way coupling: Shao & Song 2017, equations (1) to (3)."""

from refsim.backends.compile import formula


@formula
def volume_ratio(solid_sum, coupling):
    """Shao & Song (1) with M4: phi_k = V_k/V_min, V_k = 1/sum_k' W_kk'; dimensionless, `solid_sum` in [1/m^dim]."""
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
    if pressure < real(0):  # max() on a GPU would replace NaN by 0
        return real(0)
    return pressure


@formula
def coupled_pressure_pair(push_i, push_j, weight_i, weight_j, slope):
    """Shao & Song (2) with M1, M2: factor of e_ij in F_ij = -(V_i^2 p_i phi_j + V_j^2 p_j phi_i) W' [N].

    phi = 1 in the liquid; push = V^2 p [N m^(dim+1)], 0 for solids, which have no pressure of their own.
    """
    return -(push_i * weight_j + push_j * weight_i) * slope


@formula
def weighted_pressure(pressure_i, pressure_j, density_i, density_j):
    """Hu & Adams 2007: common pressure of a pair [Pa], p_ij = (rho_j p_i + rho_i p_j)/(rho_i + rho_j)."""
    return (density_j * pressure_i + density_i * pressure_j) / (density_i + density_j)


@formula
def coupled_viscosity_pair(both, viscosity, laplacian):
    """Shao & Song (3) with M3: factor of v_j - v_i in F_ij = mu V V phi lap W [N s/m]; `both` = V V phi [m^(2 dim)]."""
    return viscosity.coefficient * both * laplacian


@formula
def coupled_wall_pressure_pair(wall_mass, pressure_i, density_i, slope):
    """Shao & Song (2) at a wall, with m_i phi_b = Psi_b: factor -Psi_b p_i/rho_i^2 W' of e_ib in a_i [m/s^2]."""
    return -wall_mass * pressure_i / (density_i * density_i) * slope


@formula
def held_pressure_pair(pressure_f, density_f, x_kf, lean, lag):
    """Adami 2012 (27) at a solid's particle: p = p_f + rho_f (g - a_k).(x_k - x_f) [Pa], a_k = lag/tau [m/s^2]."""
    head = (lean[0] - lag[0]) * x_kf[0] + (lean[1] - lag[1]) * x_kf[1] + (lean[2] - lag[2]) * x_kf[2]
    return pressure_f + density_f * head


@formula
def followed(velocity, before, timestep, tau):
    """Velocity [m/s] that follows the particle's with the delay tau: u = u_before + (v - u_before) dt/(dt + tau)."""
    return before + (velocity - before) * timestep / (timestep + tau)
