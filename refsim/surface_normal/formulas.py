"""Scalar formula of surface normals, Jiang & Zhu 2023."""

from refsim.backends.compile import formula


@formula
def neighbour_volume(mass_j, density_i, density_j, own_density):
    """V_j = m_j/rho_j [m^dim]; m_j/rho_i as printed where `own_density` is set (Jiang & Zhu E10)."""
    if own_density:
        return mass_j / density_i
    return mass_j / density_j
