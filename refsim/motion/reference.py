"""A frame that turns."""

import numpy as np

from refsim.core.terms import terms


def cross_matrix(w):
    """The matrix of w x, (w x r)_a = sum_b m_ab r_b; in the unit of w [1/s, 1/s^2]."""
    x, y, z = w
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def inertia(i, w, rate, axis):
    """Euler, centrifugal, Coriolis: a_i = -dw/dt x r_i - w x (w x r_i) - 2 w x v_i [m/s^2], r_i = x_i - x_axis."""
    r = i.position - axis
    return -(terms(rate) @ r + terms(w) @ (terms(w) @ r) + 2 * (terms(w) @ i.velocity))
