"""What one particle does for the tension by normal differences, patent CN104318598A."""

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.surface_tension.normal_difference_2014.formulas import normal_difference_pair


@kernel
def tension(i, position, mass, surface_normal, neighbours, smoothing, normal_tension, acceleration):
    """Patent P7; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        if dx * dx + dy * dy + dz * dz < limit:
            f = normal_difference_pair(mass[i], mass[j], normal_tension)
            ax += f * (nx - surface_normal[j, 0])
            ay += f * (ny - surface_normal[j, 1])
            az += f * (nz - surface_normal[j, 2])
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az
