"""What one neighbour and one particle do in Becker & Teschner 2007."""

from refsim.backends.compile import kernel
from refsim.backends.tuples import scaled
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import value
from refsim.smoothing.shapes import CUBIC_SPLINE


@pair
def cohesion_pair(r, x_ij, mass_j, smoothing, attraction):
    """a_ij = -(kappa/m_i) m_j W(max(r, d)) x_ij of the cubic spline, without kappa W(0)/m_i [kg m]."""
    f = -mass_j * value(max(r * smoothing.inverse_radius, attraction.least_q), CUBIC_SPLINE)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def cohesion(i, lane, position, mass, neighbours, smoothing, attraction, acceleration):
    """Attraction -kappa m_j/m_i W(r) x_ij; added to the acceleration [m/s^2]."""
    a = neighbour_sum(cohesion_pair, i, lane, neighbours, position, None, mass, smoothing, attraction)
    strength = attraction.strength / mass[i]
    add_vector(acceleration, i, lane, scaled(a, strength))
