"""Scalar formula of one-way coupling: patent CN104318598A, equation P6 (patent P6)."""

from refsim.backends.compile import formula


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
