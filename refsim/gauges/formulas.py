"""Scalar formulas of sums over the liquid at a point."""

from refsim.backends.compile import formula


@formula
def filling_pair(mass_j, density_j, kernel):
    """V_j W with V_j = m_j/rho_j: share of the space at a point that one particle fills, dimensionless."""
    return mass_j / density_j * kernel
