"""The best rotation of a region on a GPU."""

import numpy as np

from refsim.backends.compile import cuda
from refsim.shape_matching.formulas import PRECISION, best_rotation


def solved_rotation(moments, before, floor, lost):
    """`best_rotation` of a region whose sums are float64: a quaternion, dimensionless."""
    matrix, basis = cuda.local.array((4, 4), np.float64), cuda.local.array((4, 4), np.float64)
    return best_rotation(moments, before, floor, lost, PRECISION, matrix, basis)
