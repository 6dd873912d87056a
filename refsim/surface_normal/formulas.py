"""Scalar formulas of surface normals: Jiang & Zhu 2023, equations (19) and (20)."""

from refsim.backends.compile import formula


@formula
def neighbour_volume(mass_j, density_i, density_j, own_density):
    """V_j = m_j/rho_j [m^dim]; m_j/rho_i as printed where `own_density` is set (Jiang & Zhu E10)."""
    if own_density:
        return mass_j / density_i
    return mass_j / density_j


@formula
def color_gradient_pair(volume_j, slope, support_radius):
    """J(19) for one neighbour: factor of e_ij in the normal, h V_j W'(r); dimensionless."""
    return support_radius * volume_j * slope


@formula
def corrected_pair(number_i, number_j, rest_number_density, volume_j, slope):
    """J(20) for one neighbour, before division by sum_k V_k W_ik: factor of e_ij [1/m].

    (delta_j - delta_i)/delta0 V_j W'(r).
    """
    return (number_j - number_i) / rest_number_density * volume_j * slope
