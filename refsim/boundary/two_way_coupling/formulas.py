"""Scalar formula of two-way coupling."""

from refsim.backends.compile import formula


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
