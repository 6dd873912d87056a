"""What one neighbour and one particle do in Becker & Teschner 2007."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import scaled
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.surface_tension.becker_teschner_2007 import formulas


@pair
def cohesion_pair(r, x_ij, mass_j, smoothing, attraction):
    """-m_j W(r) x_ij."""
    f = formulas.attraction_pair(mass_j, r * smoothing.inverse_radius, attraction)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def cohesion(i, lane, position, mass, neighbours, smoothing, attraction, acceleration):
    """Attraction -kappa m_j/m_i W(r) x_ij; added to the acceleration [m/s^2]."""
    a = neighbour_sum(cohesion_pair, i, lane, neighbours, position, None, mass, smoothing, attraction)
    strength = attraction.strength / mass[i]
    add_vector(acceleration, i, lane, scaled(a, strength))
