"""Scalar formulas of the winding number: solid angles of triangles and of clusters."""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import cross, difference, dot, three, triple

FOUR_PI = 4 * math.pi


@formula
def solid_angle(p, t, corner):
    """Solid angle [sr] of triangle a b c about p, positive if p sees its back (van Oosterom & Strackee 1983).

    tan(Omega/2) = A.(B x C)/(|A||B||C| + (A.B)|C| + (B.C)|A| + (C.A)|B|), A = a - p and so on.
    """
    u, v, w = (
        difference(triple(corner, t, 0), p),
        difference(triple(corner, t, 1), p),
        difference(triple(corner, t, 2), p),
    )
    a, b, c = math.sqrt(dot(u, u)), math.sqrt(dot(v, v)), math.sqrt(dot(w, w))
    below = a * b * c + dot(u, v) * c + dot(v, w) * a + dot(w, u) * b
    return type(a)(2) * math.atan2(dot(u, cross(v, w)), below)


@formula
def dipole_angle(d, c, dipole):
    """Solid angle [sr] of a far cluster c at distance d = middle - p: Omega = N.d/|d|^3, N its area vector."""
    squared = dot(d, d)
    return dot(three(dipole, c), d) / (squared * math.sqrt(squared))


@formula
def winding_at(p, clusters):
    """Winding number about p, w = sum Omega/(4 pi), dimensionless: clusters beyond their reach by their dipole."""
    real = type(p[0])
    total = real(0)
    for c in range(clusters.middle.shape[0]):
        d = difference(three(clusters.middle, c), p)
        if dot(d, d) > clusters.reach[c] * clusters.reach[c]:
            total += dipole_angle(d, c, clusters.dipole)
        else:
            for t in range(clusters.first[c], clusters.first[c + 1]):
                total += solid_angle(p, t, clusters.corner)
    return total / real(FOUR_PI)
