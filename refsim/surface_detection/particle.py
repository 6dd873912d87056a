"""What one particle does in surface detection; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.surface_detection.formulas import in_scan_region, moment_weight

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


@formula
def moments_row(i, row, position, source, index, fan_scan, sums):
    """Sums of w, w u and w u u^T over one list, u = x_ij/h, w = 1 - |u|^2, added to `sums`; dimensionless."""
    first, stride, count = row
    h = fan_scan.support_radius
    weight, mx, my, mz, xx, xy, xz, yy, yz, zz = sums
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = (x - source[j, 0]) / h, (y - source[j, 1]) / h, (z - source[j, 2]) / h
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < type(h)(1):
            w = moment_weight(r2)
            weight += w
            mx += w * dx
            my += w * dy
            mz += w * dz
            xx += w * dx * dx
            xy += w * dx * dy
            xz += w * dx * dz
            yy += w * dy * dy
            yz += w * dy * dz
            zz += w * dz * dz
    return weight, mx, my, mz, xx, xy, xz, yy, yz, zz


@formula
def own_moments(fan_scan):
    """The sums of `moments_row` over the particle alone: weight 1 at u = 0."""
    zero = type(fan_scan.support_radius)(0)
    return type(zero)(1), zero, zero, zero, zero, zero, zero, zero, zero, zero
