"""What one particle does in Tartakovsky & Meakin 2005; the CPU and the CUDA kernels share this loop.

`row` is (first, stride, count) of the particle's neighbours in `index`.
"""

import math

from refsim.backends.compile import formula
from refsim.surface_tension.tartakovsky_meakin_2005 import formulas


@formula
def cosine_cohesion(i, row, position, mass, index, smoothing, cosine_force):
    """Pair force s cos(3 pi r/(2 h)) e_ij: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    strength = cosine_force.strength / mass[i]
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = formulas.force_shape(r, cosine_force) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return strength * ax, strength * ay, strength * az
