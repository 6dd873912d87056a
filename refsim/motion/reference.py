"""NumPy oracle of a frame that turns, float64."""

import numpy as np

from refsim.core.operation import operation


@operation(
    "Euler, centrifugal and Coriolis acceleration", paper="standard", adds="acceleration", tolerance=8.0,
    reason="one rounding in each of the separation from the axis, six products and their sums", invariants="reordering",
)  # fmt: skip
def turning(position, velocity, turning, rows=None):
    """Acceleration [m/s^2] a_i = -dw/dt x r_i - w x (w x r_i) - 2 w x v_i, r_i = x_i - x_axis.

    turning (9,): w [1/s], dw/dt [1/s^2], a point of the axis [m]. Returns (value, scale).
    """
    pick = slice(None) if rows is None else np.asarray(rows)
    x, v = (np.asarray(a, dtype=float)[pick] for a in (position, velocity))
    w, rate, axis = np.asarray(turning, dtype=float).reshape(3, 3)
    spin, change = (np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]]) for a, b, c in (w, rate))
    r, size = x - axis, np.abs(x) + np.abs(axis)
    twice = spin @ spin
    value = -(r @ change.T + r @ twice.T + 2 * v @ spin.T)
    scale = size @ np.abs(change).T + size @ (np.abs(spin) @ np.abs(spin)).T + 2 * np.abs(v) @ np.abs(spin).T
    return {"acceleration": (value, scale)}
