"""What one neighbour and one particle do for the tension by normal differences, patent CN104318598A."""

from refsim.backends.tuples import difference, scaled
from refsim.neighbours.forces import force
from refsim.neighbours.pairs import pair


@pair
def difference_pair(mass_i, mass_j, surface_normal_i, surface_normal_j, smoothing, normal_tension):
    """Patent P7: F_ij/m_i = -2 gamma m_j/(m_i + m_j) (n_i - n_j) [m/s^2]; as printed -gamma (n_i - n_j)."""
    f = -normal_tension.coefficient
    if not normal_tension.printed_mass:
        f = f * (mass_j + mass_j) / (mass_i + mass_j)
    a = scaled(difference(surface_normal_i, surface_normal_j), f)
    return a[0], a[1], a[2]


tension = force(difference_pair, "tension")
