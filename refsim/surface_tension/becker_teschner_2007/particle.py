"""What one particle does in Becker & Teschner 2007; the CPU and the CUDA kernels share this loop.

`row` is (first, stride, count) of the particle's neighbours in `index`.
"""

import math

from refsim.backends.compile import formula
from refsim.surface_tension.becker_teschner_2007 import formulas


@formula
def cohesion(i, row, position, mass, index, smoothing, attraction):
    """Attraction -kappa m_j/m_i W(r) x_ij: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    strength = attraction.strength / mass[i]
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            q = math.sqrt(r2) * smoothing.inverse_radius
            f = formulas.attraction_pair(mass[j], q, attraction)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return strength * ax, strength * ay, strength * az
