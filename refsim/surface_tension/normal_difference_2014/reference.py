"""Patent CN104318598A, 2014: tension by normal differences."""


def tension(i, j, ij, gamma, printed):
    """P7 a_i = -(gamma/m_i) sum_j m_i m_j/((m_i + m_j)/2) (n_i - n_j) [m/s^2]; printed m_i, not the harmonic mean."""
    share = 1.0 if printed else j.mass / (0.5 * (i.mass + j.mass))
    return -gamma * share * (i.normal - j.normal)
