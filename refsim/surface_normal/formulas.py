"""Formulas of surface normals, Jiang & Zhu 2023."""

from refsim.backends.compile import formula
from refsim.backends.tuples import dot, over, scaled
from refsim.smoothing.formulas import safe_distance


@formula
def neighbour_volume(mass_j, density_i, density_j, own_density):
    """V_j = m_j/rho_j [m^dim]; m_j/rho_i as printed where `own_density` is set (Jiang & Zhu E10)."""
    if own_density:
        return mass_j / density_i
    return mass_j / density_j


@formula
def axial_part(apart, x_ij, r, smoothing, axial):
    """s (a . e_ij) e_ij of a = n_i - n_j, with e_ij = x_ij/r, 0 for particles in one place [unit of n]."""
    unit = over(x_ij, safe_distance(r, smoothing))
    return scaled(unit, axial.factor * dot(apart, unit))
