"""What one particle does in Becker & Teschner 2007."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.surface_tension.becker_teschner_2007 import formulas


@kernel
def cohesion(i, position, mass, neighbours, smoothing, attraction, acceleration):
    """Attraction -kappa m_j/m_i W(r) x_ij; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    strength = attraction.strength / mass[i]
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            q = math.sqrt(r2) * smoothing.inverse_radius
            f = formulas.attraction_pair(mass[j], q, attraction)
            ax += f * dx
            ay += f * dy
            az += f * dz
    acceleration[i, 0] += strength * ax
    acceleration[i, 1] += strength * ay
    acceleration[i, 2] += strength * az
