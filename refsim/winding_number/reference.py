"""The winding number w = sum_t Omega_t/(4 pi) of a mesh about a point (Jacobson eq. 5)."""

import numpy as np


def half_angles(points, corners):
    """tan(Omega/2) = det(a, b, c)/(|a||b||c| + (a.b)|c| + (b.c)|a| + (c.a)|b|): (above, below) the line [m^3].

    a, b, c are the corners of triangles (t, 3, 3) from points (n, 3).
    """
    a, b, c = (corners[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
    below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.linalg.det(np.stack([a, b, c], axis=-2)), below


def solid_angles(points, corners):
    """Van Oosterom & Strackee: Omega = 2 atan2(above, below) [sr] of triangles (t, 3, 3) about points (n, 3)."""
    return 2 * np.arctan2(*half_angles(points, corners))


def dipole_angle(N, d):
    """Barill eq. 4: Omega = N.d/|d|^3 [sr] of a far cluster, d its middle from the point."""
    return d * N / np.linalg.norm(d, axis=1)[:, None] ** 3
