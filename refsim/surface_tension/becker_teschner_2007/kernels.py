"""What one neighbour and one particle do in Becker & Teschner 2007."""

from refsim.neighbours.forces import force
from refsim.neighbours.pairs import pair
from refsim.smoothing.formulas import value
from refsim.smoothing.shapes import CUBIC_SPLINE


@pair
def cohesion_pair(r, x_ij, mass_i, mass_j, smoothing, attraction):
    """a_ij = -kappa 2 m_j/(m_i + m_j) W(max(r, d)) x_ij of the cubic spline, without kappa W(0) [m]."""
    w = value(max(r * smoothing.inverse_radius, attraction.least_q), CUBIC_SPLINE)
    f = -(mass_j + mass_j) / (mass_i + mass_j) * w
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


cohesion = force(cohesion_pair, times="attraction.strength")
