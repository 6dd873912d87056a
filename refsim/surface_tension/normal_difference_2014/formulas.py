"""Scalar formula of the tension by normal differences: patent CN104318598A, patent P7."""

from refsim.backends.compile import formula


@formula
def normal_difference_pair(mass_i, mass_j, normal_tension):
    """Patent P7 for one neighbour: factor of n_i - n_j in the acceleration F/m_i [m/s^2], -2 gamma m_j/(m_i + m_j).

    F_ij = -gamma m_i m_j/((m_i + m_j)/2) (n_i - n_j); as printed F_ij = -gamma m_i (n_i - n_j).
    """
    if normal_tension.printed_mass:
        return -normal_tension.coefficient
    return -normal_tension.coefficient * (mass_j + mass_j) / (mass_i + mass_j)
