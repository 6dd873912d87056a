"""Formula of a frame that turns."""

from refsim.backends.compile import formula
from refsim.backends.tuples import cross


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
