"""What one particle does in Dong, Zhang & Chen 2016; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.surface_tension.dong_2016 import formulas


@formula
def kernel_sum(i, row, position, index, smoothing):
    """Sum of W_ij over the fluid, self included [1/m^dim]."""
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    total = kernel_value(type(h)(0), smoothing)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            total += kernel_value(math.sqrt(r2), smoothing)
    return total


@formula
def momentum(i, row, position, velocity, mass, density, pressure, index, smoothing, viscosity):
    """D(4) and, unless `viscosity` is None, D(5): acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    u, v, w = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    volume = mass[i] / density[i]
    squared = volume * volume
    own = pressure[i]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            apart = r + tiny
            volume_j = mass[j] / density[j]
            squared_j = volume_j * volume_j
            slope = kernel_slope(r, smoothing)
            f = formulas.pressure_pair(squared, squared_j, own, pressure[j], slope) / apart
            ax += f * dx
            ay += f * dy
            az += f * dz
            if viscosity is not None:
                g = formulas.viscosity_pair(squared, squared_j, viscosity, slope, apart)
                ax += g * (u - velocity[j, 0])
                ay += g * (v - velocity[j, 1])
                az += g * (w - velocity[j, 2])
    m = mass[i]
    return ax / m, ay / m, az / m


@formula
def tension(i, row, position, mass, density, surface_normal, index, smoothing, molecular_force, normal_difference):
    """D(6) with D(7), and D(9) with D(11), each unless None: acceleration of particle i [m/s^2].

    `surface_normal` is h n_i of D(11); the correction's coefficient holds the 1/h.
    """
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if normal_difference is not None:
        nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            if molecular_force is not None:
                f = formulas.cohesion_pair(mass[j], r * smoothing.inverse_radius, molecular_force) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
            if normal_difference is not None:
                kernel = kernel_value(r, smoothing)
                g = formulas.correction_pair(mass[j], density[i], density[j], kernel, normal_difference)
                ax += g * (nx - surface_normal[j, 0])
                ay += g * (ny - surface_normal[j, 1])
                az += g * (nz - surface_normal[j, 2])
    return ax, ay, az
