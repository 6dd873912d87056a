"""What one neighbour and one particle do for the tension by normal differences, patent CN104318598A."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import difference, scaled
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector


@pair
def difference_pair(mass_i, mass_j, surface_normal_i, surface_normal_j, smoothing, normal_tension):
    """Patent P7: F_ij/m_i = -2 gamma m_j/(m_i + m_j) (n_i - n_j) [m/s^2]; as printed -gamma (n_i - n_j)."""
    f = -normal_tension.coefficient
    if not normal_tension.printed_mass:
        f = f * (mass_j + mass_j) / (mass_i + mass_j)
    a = scaled(difference(surface_normal_i, surface_normal_j), f)
    return a[0], a[1], a[2]


@kernel(lanes=True)
def tension(i, lane, position, mass, surface_normal, neighbours, smoothing, normal_tension, acceleration):
    """Patent P7; added to the acceleration [m/s^2]."""
    a = neighbour_sum(
        difference_pair, i, lane, neighbours, position, None, mass, surface_normal, smoothing, normal_tension
    )
    add_vector(acceleration, i, lane, a)
