"""Formulas of a frame that turns."""

from refsim.backends.compile import formula
from refsim.backends.tuples import added, cross, difference, three


@formula
def turning_acceleration(r, v, w, rate):
    """a = -(dw/dt x r + w x (w x r) + 2 w x v) [m/s^2]; r from the axis [m], v [m/s], w [1/s], rate = dw/dt [1/s^2]."""
    turned, inwards, sideways = cross(rate, r), cross(w, cross(w, r)), cross(w, v)
    two = type(r[0])(2)
    return (
        -(turned[0] + inwards[0] + two * sideways[0]),
        -(turned[1] + inwards[1] + two * sideways[1]),
        -(turned[2] + inwards[2] + two * sideways[2]),
    )


@formula
def felt(i, position, velocity, lean, turning):
    """a = g - dw/dt x r - w x (w x r) - 2 w x v [m/s^2] of i, at rest without a velocity; g where nothing turns."""
    g = lean[0], lean[1], lean[2]
    if turning is None:
        return g
    r = difference(three(position, i), (turning[6], turning[7], turning[8]))
    v = difference(r, r)
    if velocity is not None:
        v = three(velocity, i)
    w, rate = (turning[0], turning[1], turning[2]), (turning[3], turning[4], turning[5])
    return added(g, turning_acceleration(r, v, w, rate))
