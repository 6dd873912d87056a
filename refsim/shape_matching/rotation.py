"""The best rotation of a region, with matrices that lie on the heap on a CPU and in local memory on a GPU."""

import numpy as np

from refsim.backends.compile import overloaded
from refsim.shape_matching.formulas import PRECISION, best_rotation


def solved_rotation(moments, before, floor, lost):
    """`best_rotation` of a region whose sums are float64: a quaternion, dimensionless."""
    matrix, basis = np.empty((4, 4), np.float64), np.empty((4, 4), np.float64)
    return best_rotation(moments, before, floor, lost, PRECISION, matrix, basis)


def _on_cpu(moments, before, floor, lost):
    return solved_rotation


def _on_cuda(moments, before, floor, lost):
    from refsim.shape_matching import rotation_cuda  # loads numba.cuda, which a CPU does without

    return rotation_cuda.solved_rotation


# What stands for it in a file that is printed (`refsim.backends.written`).
solved_rotation.written_on = {"cuda": lambda: _on_cuda(None, None, None, None)}  # type: ignore[attr-defined]

# On a CPU the matrices are freed by the count of references to them, which the kernels' bodies leave out.
for _target, _chosen in (("cpu", _on_cpu), ("cuda", _on_cuda)):
    overloaded(solved_rotation, _chosen, (_target,), _nrt=True)
