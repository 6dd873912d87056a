"""The operation of the winding number: every point against every triangle of a near cluster, float64."""

import numpy as np

from refsim.core.operation import operation
from refsim.winding_number import reference as ref

# Relative distance from a triangle's plane, or from a cluster's reach, within which a row is not judged
UNDECIDED = 1e-5


def rounding(points, corners):
    """What rounding does to a solid angle, over the rounding of one [dimensionless]: |a||b||c|/|(above, below)|."""
    above, below = ref.half_angles(points, corners)
    size, length = np.linalg.norm(corners[None] - points[:, None, None], axis=-1).prod(-1), np.hypot(above, below)
    sure = (length > 0) & ((np.abs(above) > UNDECIDED * size) | (below > UNDECIDED * size))
    return np.divide(size, length, out=np.full(length.shape, np.inf), where=sure)


@operation(
    "Jacobson eq. 5: sum of solid angles over 4 pi; Barill eq. 4: far clusters by their dipole",
    paper="Jacobson, Kavan & Sorkine-Hornung 2013; Barill, Dickson, Schmidt, Levin & Jacobson 2018",
    outputs="winding_number", entrywise=True, tolerance=16.0,
    reason="one rounding in each difference, length, product, sum and angle of a triangle", cases="wound_bodies",
)  # fmt: skip
def winding(viewpoint, clusters):
    """Winding numbers [dimensionless] at points, of clusters beyond their reach by their dipoles."""
    points, first = np.asarray(viewpoint, dtype=float), np.asarray(clusters.first)
    corners = np.asarray(clusters.corner, dtype=float).reshape(-1, 3, 3)
    value, scale = np.zeros((2, len(points)))
    for k in range(len(first) - 1):
        away, reach = np.asarray(clusters.middle[k], dtype=float) - points, float(clusters.reach[k])
        distance = np.linalg.norm(away, axis=1)
        far, near = distance > reach, np.flatnonzero(~(distance > reach))
        angle = ref.dipole_angle(np.asarray(clusters.dipole[k], dtype=float), away[far])
        value[far] += angle.sum(1)
        scale[far] += np.abs(angle).sum(1)
        seen = points[near], corners[first[k] : first[k + 1]]
        angle = ref.solid_angles(*seen)
        value[near] += angle.sum(1)
        scale[near] += (np.abs(angle) + rounding(*seen)).sum(1)
        scale[np.abs(distance - reach) <= UNDECIDED * reach] = np.inf
    return {"winding_number": (value / (4 * np.pi), scale / (4 * np.pi))}
