"""The operation of a frame that turns."""

import numpy as np

from refsim.core.operation import operation
from refsim.core.terms import Terms
from refsim.motion import reference as ref
from refsim.neighbours.sums import Fields


@operation(
    "Euler, centrifugal and Coriolis acceleration", paper="standard", adds="acceleration", tolerance=8.0,
    reason="one rounding in each of the separation from the axis, six products and their sums", invariants="reordering",
)  # fmt: skip
def turning(position, velocity, turning, rows=None):
    """Acceleration [m/s^2]; turning (9,): w [1/s], dw/dt [1/s^2], a point of the axis [m]."""
    return {"acceleration": inertia(Fields(position=position, velocity=velocity).at(rows), turning)}


def inertia(i, turning):
    """Acceleration [m/s^2] of what has a position and a velocity in a frame that turns."""
    w, rate, axis = np.asarray(turning, dtype=float).reshape(3, 3)
    return ref.inertia(i, ref.cross_matrix(w), ref.cross_matrix(rate), axis)


def felt(i, lean, turning):
    """Gravity and inertia [m/s^2] of what has a position and a velocity; without `turning` gravity alone."""
    g = Terms([float(part) for part in lean], rank=1)
    return g if turning is None else g + inertia(i, turning)
