"""NumPy oracle of the winding number: every point against every triangle, float64."""

import numpy as np

from refsim.core.operation import operation
from refsim.neighbours.reference import Sums

# Relative distance from a triangle's plane, or from a cluster's reach, within which a row is not judged
UNDECIDED = 1e-5


def solid_angles(points, corners):
    """((n, t) solid angles [sr] of triangles (t, 3, 3) about points (n, 3), (n, t) rounding's scale of each)."""
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
    above = np.linalg.det(np.stack([a, b, c], axis=-2))
    below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    size, length = la * lb * lc, np.hypot(above, below)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.where(length > 0, size / length, np.inf)
    scale = np.where((np.abs(above) <= UNDECIDED * size) & (below <= UNDECIDED * size), np.inf, scale)
    return 2 * np.arctan2(above, below), scale


@operation(
    "Jacobson eq. 5: sum of solid angles over 4 pi; Barill eq. 4: far clusters by their dipole",
    paper="Jacobson, Kavan & Sorkine-Hornung 2013; Barill, Dickson, Schmidt, Levin & Jacobson 2018",
    outputs="winding_number", entrywise=True, tolerance=16.0,
    reason="one rounding in each difference, length, product, sum and angle of a triangle", cases="wound_bodies",
)  # fmt: skip
def winding(viewpoint, clusters):
    """Jacobson eq. 5, Barill eq. 4: w = sum Omega/(4 pi) [dimensionless], Omega = N.d/|d|^3 beyond the reach."""
    points, first = np.asarray(viewpoint, dtype=float), np.asarray(clusters.first)
    corners = np.asarray(clusters.corner, dtype=float).reshape(-1, 3, 3)
    sums = Sums(len(points))
    for k in range(len(first) - 1):
        away = np.asarray(clusters.middle[k], dtype=float) - points
        distance, reach = np.linalg.norm(away, axis=1), float(clusters.reach[k])
        far = distance > reach
        near = np.flatnonzero(~far)
        sums.add(far, away[far] * np.asarray(clusters.dipole[k], dtype=float) / distance[far, None] ** 3)
        angle, rounding = solid_angles(points[near], corners[first[k] : first[k + 1]])
        sums.add(near, angle, np.abs(angle) + rounding)
        sums.scale[np.abs(distance - reach) <= UNDECIDED * reach] = np.inf
    return {"winding_number": sums.total(4 * np.pi)}
