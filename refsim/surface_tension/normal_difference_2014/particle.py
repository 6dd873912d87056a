"""What one particle does for the tension by normal differences; the CPU and the CUDA kernels share the loop."""

from refsim.backends.compile import formula
from refsim.surface_tension.normal_difference_2014.formulas import difference_pair


@formula
def tension(i, row, position, mass, surface_normal, index, smoothing, normal_tension):
    """P7: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        if dx * dx + dy * dy + dz * dz < limit:
            f = difference_pair(mass[i], mass[j], normal_tension)
            ax += f * (nx - surface_normal[j, 0])
            ay += f * (ny - surface_normal[j, 1])
            az += f * (nz - surface_normal[j, 2])
    return ax, ay, az
