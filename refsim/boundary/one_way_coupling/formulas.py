"""Scalar formulas of one-way coupling: patent CN104318598A, equation P6 (patent P6)."""

from refsim.backends.compile import formula


@formula
def boundary_viscosity_pair(wall_mass, density_i, wall_viscosity, laplacian):
    """Patent P6 with E30: factor mu Psi_b/rho_i^2 lap W_ib of v_b - v_i in the acceleration [1/s].

    From F_ib = mu (m_i/rho_i) (Psi_b/rho_i) (v_b - v_i) lap W_ib, Psi_b = rho0 V_b; v_b = 0.
    """
    return wall_viscosity.coefficient * wall_mass / (density_i * density_i) * laplacian


@formula
def boundary_pressure(mean, gravity, dx, dy, dz, fluid):
    """Patent P6 with E30: p_b = p~_i + rho0 g.(x_b - x_i) [Pa], (dx, dy, dz) = x_i - x_b [m].

    `mean` is p~_i, the mean pressure of the liquid around x_i, extrapolated to x_i (Adami, Hu & Adams 2012, (27)).
    """
    head = gravity[0] * dx + gravity[1] * dy + gravity[2] * dz
    pressure = mean - fluid.rest_density * head
    if fluid.clamp and pressure < type(pressure)(0):
        return type(pressure)(0)
    return pressure


@formula
def boundary_pressure_pair(wall_mass, density_i, pressure_b, slope, fluid):
    """Patent P6 with E30: factor f = -s Psi_b p_b/rho_i^2 W'(r) of e_ib in the acceleration a_i [m/s^2]."""
    return -fluid.gradient_share * wall_mass * pressure_b / (density_i * density_i) * slope
