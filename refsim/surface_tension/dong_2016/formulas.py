"""Scalar formulas of Dong, Zhang & Chen 2016, equations D(4) to D(10)."""

from refsim.backends.compile import formula


@formula
def force_shape(q, molecular_force):
    """D(7) L(r)/k = ((1 - q)^4 - (1 - e)^2 (1 - q)^2)/(e (2 - e)), e = d0/h; dimensionless, > 0 repels."""
    real = type(q)
    a = (real(1) - q) * (real(1) - q)
    return (a - molecular_force.rest_share) * a * molecular_force.scale


@formula
def correction_pair(mass_j, density_i, density_j, kernel, normal_correction):
    """D(9): factor of (n_i - n_j) in the acceleration of i, -lambda V_j W_ij [m^2/s^2] for n in 1/m.

    V_j = 2 m_j/(rho_i + rho_j), with which D(10) holds (Dong E21); or m_j/rho_j; the formula is lost.
    """
    if normal_correction.symmetric:
        return -normal_correction.coefficient * (mass_j + mass_j) / (density_i + density_j) * kernel
    return -normal_correction.coefficient * mass_j / density_j * kernel
