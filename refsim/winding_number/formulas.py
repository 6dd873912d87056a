"""Scalar formulas of the winding number: solid angles of triangles and of clusters."""

import math

from refsim.backends.compile import formula

FOUR_PI = 4 * math.pi


@formula
def solid_angle(px, py, pz, t, corner):
    """Solid angle [sr] of triangle a b c about p, positive if p sees its back (van Oosterom & Strackee 1983).

    tan(Omega/2) = A.(B x C)/(|A||B||C| + (A.B)|C| + (B.C)|A| + (C.A)|B|), A = a - p and so on.
    """
    real = type(px)
    ax, ay, az = corner[t, 0] - px, corner[t, 1] - py, corner[t, 2] - pz
    bx, by, bz = corner[t, 3] - px, corner[t, 4] - py, corner[t, 5] - pz
    cx, cy, cz = corner[t, 6] - px, corner[t, 7] - py, corner[t, 8] - pz
    a = math.sqrt(ax * ax + ay * ay + az * az)
    b = math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    above = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    below = (
        a * b * c
        + (ax * bx + ay * by + az * bz) * c
        + (bx * cx + by * cy + bz * cz) * a
        + (cx * ax + cy * ay + cz * az) * b
    )
    return real(2) * math.atan2(above, below)


@formula
def dipole_angle(dx, dy, dz, c, dipole):
    """Solid angle [sr] of a far cluster c at distance d = middle - p: Omega = N.d/|d|^3, N its area vector."""
    squared = dx * dx + dy * dy + dz * dz
    return (dipole[c, 0] * dx + dipole[c, 1] * dy + dipole[c, 2] * dz) / (squared * math.sqrt(squared))


@formula
def winding_at(px, py, pz, clusters):
    """Winding number about p, w = sum Omega/(4 pi), dimensionless: clusters beyond their reach by their dipole."""
    real = type(px)
    total = real(0)
    for c in range(clusters.middle.shape[0]):
        dx, dy, dz = clusters.middle[c, 0] - px, clusters.middle[c, 1] - py, clusters.middle[c, 2] - pz
        if dx * dx + dy * dy + dz * dz > clusters.reach[c] * clusters.reach[c]:
            total += dipole_angle(dx, dy, dz, c, clusters.dipole)
        else:
            for t in range(clusters.first[c], clusters.first[c + 1]):
                total += solid_angle(px, py, pz, t, clusters.corner)
    return total / real(FOUR_PI)
