"""Scalar formulas of He et al. 2014."""

from refsim.backends.compile import formula


@formula
def color_gradient_pair(volume_j, color_j, slope):
    """c_i grad c_i = sum_j V_j c_j W'(r) e_ij: the factor of e_ij for one neighbour [1/m]."""
    return volume_j * color_j * slope


@formula
def gradient_energy_pair(volume_j, squared_i, squared_j, slope, gradient_energy):
    """rho_i a_i = (kappa/4) sum_j V_j (|grad c_i|^2 + |grad c_j|^2) W'(r) e_ij: the factor of e_ij [N/m^3]."""
    return gradient_energy.quarter * volume_j * (squared_i + squared_j) * slope


@formula
def air_pressure_pair(volume_j, slope, air_pressure):
    """rho_i a_i = p_atm sum_j V_j W'(r) e_ij: the factor of e_ij for one neighbour [N/m^3]."""
    return air_pressure.pressure * volume_j * slope
