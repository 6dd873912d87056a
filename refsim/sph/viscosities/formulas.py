"""Scalar formulas of the viscous forces: Monaghan 1992; Morris, Fox & Zhu 1997."""

from refsim.backends.compile import formula


@formula
def artificial_pair(r, approach, mass_j, density, slope, artificial_viscosity):
    """Monaghan 1992 for one neighbour: factor of x_ij in the acceleration [1/s^2], -m_j Pi_ij W'(r)/r.

    `approach` = (v_i - v_j).x_ij [m^2/s], `density` the mean of both [kg/m^dim], `slope` = W'(r)/r.
    """
    real = type(r)
    if approach >= real(0):
        return real(0)
    h = artificial_viscosity.smoothing_length
    mu = h * approach / (r * r + real(0.01) * h * h)
    c, alpha, beta = artificial_viscosity.sound_speed, artificial_viscosity.alpha, artificial_viscosity.beta
    return mass_j * mu * (alpha * c - beta * mu) / density * slope


@formula
def laminar_pair(r, volume_j, slope, laminar_viscosity):
    """Morris, Fox & Zhu 1997 for one neighbour: factor of v_i - v_j in the force density [N s/m^4].

    2 mu V_j x_ij.grad W_ij/(r^2 + 0.01 h_s^2), `slope` = W'(r)/r.
    """
    real = type(r)
    h = laminar_viscosity.smoothing_length
    share = r * r / (r * r + real(0.01) * h * h)
    return real(2) * laminar_viscosity.dynamic_viscosity * volume_j * share * slope
