"""Scalar formula of Becker & Teschner 2007."""

from refsim.backends.compile import formula
from refsim.smoothing.formulas import value
from refsim.smoothing.shapes import CUBIC_SPLINE


@formula
def attraction_pair(mass_j, q, attraction):
    """a_ij = -(kappa/m_i) m_j W(max(r, d)) x_ij, cubic spline: the factor of kappa W(0)/m_i x_ij [kg]."""
    return -mass_j * value(max(q, attraction.least_q), CUBIC_SPLINE)
