"""Scalar formulas of Dong, Zhang & Chen 2016, equations D(4) to D(10)."""

from refsim.backends.compile import formula


@formula
def force_shape(q, molecular_force):
    """D(7) L(r)/k = ((1 - q)^4 - (1 - e)^2 (1 - q)^2)/(e (2 - e)), e = d0/h; dimensionless, > 0 repels."""
    real = type(q)
    a = (real(1) - q) * (real(1) - q)
    return (a - molecular_force.rest_share) * a * molecular_force.scale


@formula
def cohesion_pair(mass_j, q, molecular_force):
    """D(6): factor of e_ij in the acceleration of i, m_j L(r) [m/s^2]."""
    return mass_j * (molecular_force.stiffness * force_shape(q, molecular_force))


@formula
def correction_pair(mass_j, density_i, density_j, kernel, normal_correction):
    """D(9): factor of (n_i - n_j) in the acceleration of i, -lambda V_j W_ij [m^2/s^2] for n in 1/m.

    V_j = 2 m_j/(rho_i + rho_j), with which D(10) holds (Dong E21); printed m_j/rho_j.
    """
    if normal_correction.symmetric:
        return -normal_correction.coefficient * (mass_j + mass_j) / (density_i + density_j) * kernel
    return -normal_correction.coefficient * mass_j / density_j * kernel


@formula
def hu_adams_pressure_pair(squared_volume_i, squared_volume_j, pressure_i, pressure_j, slope):
    """D(4): factor of e_ij in the force on i, -(V_i^2 p_i + V_j^2 p_j) W'(r) [N]."""
    return -(squared_volume_i * pressure_i + squared_volume_j * pressure_j) * slope


@formula
def hu_adams_viscosity_pair(squared_volume_i, squared_volume_j, viscosity, slope, apart):
    """D(5): factor of (v_i - v_j) in the force on i, mu (V_i^2 + V_j^2) W'(r)/r [N s/m]; never positive.

    For one liquid 2 mu_i mu_j/(mu_i + mu_j) is mu.
    """
    return viscosity.coefficient * (squared_volume_i + squared_volume_j) * slope / apart
