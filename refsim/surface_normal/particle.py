"""What one particle does for its normal; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.surface_normal.formulas import color_gradient_pair, corrected_pair, neighbour_volume


@formula
def color_gradient(i, row, position, mass, density, index, gradient_smoothing, normal_term):
    """J(19) over the fluid: h sum_j V_j grad W_ij; dimensionless."""
    first, stride, count = row
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own = density[i]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            volume = neighbour_volume(mass[j], own, density[j], normal_term.own_density)
            f = color_gradient_pair(volume, kernel_slope(r, gradient_smoothing), h) / (r + tiny)
            nx += f * dx
            ny += f * dy
            nz += f * dz
    return nx, ny, nz


@formula
def wall_color_gradient(i, row, position, walls, gradient_smoothing):
    """J(19) over the walls: h sum_b V_b grad W_ib; dimensionless."""
    first, stride, count = row
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            f = color_gradient_pair(walls.volume[b], kernel_slope(r, gradient_smoothing), h) / (r + tiny)
            nx += f * dx
            ny += f * dy
            nz += f * dz
    return nx, ny, nz


@formula
def corrected_sums(i, row, position, mass, density, number_density, index, smoothing, gradient_smoothing, normal_term):
    """J(20) over the fluid: (three components of the sum of gradients [1/m], sum_k V_k W_ik with self [-])."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    nx, ny, nz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own, number = density[i], number_density[i]
    filled = mass[i] / own * kernel_value(real(0), smoothing)
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            filled += mass[j] / density[j] * kernel_value(r, smoothing)
            volume = neighbour_volume(mass[j], own, density[j], normal_term.own_density)
            slope = kernel_slope(r, gradient_smoothing)
            f = corrected_pair(number, number_density[j], normal_term.rest_number_density, volume, slope) / (r + tiny)
            nx += f * dx
            ny += f * dy
            nz += f * dz
    return nx, ny, nz, filled
