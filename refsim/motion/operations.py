"""The operation of a frame that turns."""

import numpy as np

from refsim.core.operation import operation
from refsim.motion import reference as ref
from refsim.neighbours.sums import Fields


@operation(
    "Euler, centrifugal and Coriolis acceleration", paper="standard", adds="acceleration", tolerance=8.0,
    reason="one rounding in each of the separation from the axis, six products and their sums", invariants="reordering",
)  # fmt: skip
def turning(position, velocity, turning, rows=None):
    """Acceleration [m/s^2]; turning (9,): w [1/s], dw/dt [1/s^2], a point of the axis [m]."""
    i = Fields(position=position, velocity=velocity).at(rows)
    w, rate, axis = np.asarray(turning, dtype=float).reshape(3, 3)
    return {"acceleration": ref.inertia(i, ref.cross_matrix(w), ref.cross_matrix(rate), axis)}
