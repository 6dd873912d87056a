"""Scalar formulas of one-way coupling: patent CN104318598A, P6."""

from refsim.backends.compile import formula


@formula
def wall_viscosity_pair(wall_mass, density_i, wall_viscosity, laplacian):
    """P6 for one boundary particle: factor of v_b - v_i in the acceleration [1/s], mu Psi_b/rho_i^2 lap W_ib (E30).

    From F_ib = mu (m_i/rho_i) (Psi_b/rho_i) (v_b - v_i) lap W_ib, Psi_b = rho0 V_b; v_b = 0.
    """
    return wall_viscosity.coefficient * wall_mass / (density_i * density_i) * laplacian


@formula
def wall_own_pressure(around, gravity, dx, dy, dz, fluid):
    """P6 with E30, p_b [Pa]: p~_i + rho0 g.(x_b - x_i), (dx, dy, dz) = x_i - x_b [m] (Adami, Hu & Adams 2012, (27)).

    p~_i is the pressure of the liquid around particle i, led to its place.
    """
    deeper = gravity.x * dx + gravity.y * dy + gravity.z * dz
    pressure = around - fluid.rest_density * deeper
    if fluid.clamp and pressure < type(pressure)(0):
        return type(pressure)(0)
    return pressure


@formula
def wall_pressure_pair(wall_mass, density_i, pressure_b, slope, fluid):
    """P6 with E30 for one boundary particle: factor f = -s Psi_b p_b/rho_i^2 W'(r) of e_ib in a_i [m/s^2]."""
    return -fluid.gradient_share * wall_mass * pressure_b / (density_i * density_i) * slope
