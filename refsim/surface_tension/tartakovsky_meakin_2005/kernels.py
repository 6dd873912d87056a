"""What one particle does in Tartakovsky & Meakin 2005."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.surface_tension.tartakovsky_meakin_2005 import formulas


@kernel
def cosine_cohesion(i, position, mass, neighbours, smoothing, cosine_force, acceleration):
    """Pair force s cos(3 pi r/(2 h)) e_ij over m_i; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    strength = cosine_force.strength / mass[i]
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = formulas.force_shape(r, cosine_force) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    acceleration[i, 0] += strength * ax
    acceleration[i, 1] += strength * ay
    acceleration[i, 2] += strength * az
