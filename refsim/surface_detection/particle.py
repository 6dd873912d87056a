"""What one particle does in the fan scan; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.compile import formula
from refsim.surface_detection.formulas import in_scan_region

ENOUGH = 3  # neighbours below which a particle is spray (E20)


@formula
def unit(vector, i, smallest):
    """(components of row i divided by its length, whether that is at least `smallest`)."""
    x, y, z = vector[i, 0], vector[i, 1], vector[i, 2]
    length = math.sqrt(x * x + y * y + z * z)
    if length < smallest:
        zero = type(length)(0)
        return zero, zero, zero, False
    return x / length, y / length, z / length, True


@formula
def scan_row(i, row, position, source, index, normal, fan_scan, near, occupied):
    """J(13) over one list: (neighbours within the support radius, at most ENOUGH; whether the region is occupied).

    `near` and `occupied` are what other lists gave; the loop ends as soon as nothing can change any more.
    """
    first, stride, count = row
    limit = fan_scan.support_radius * fan_scan.support_radius
    nx, ny, nz = normal
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        if occupied and near >= ENOUGH:
            break
        j = index[first + k * stride]
        dx, dy, dz = x - source[j, 0], y - source[j, 1], z - source[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            near += 1
        occupied = occupied or in_scan_region(r2, nx * dx + ny * dy + nz * dz, fan_scan)
    return near, occupied
