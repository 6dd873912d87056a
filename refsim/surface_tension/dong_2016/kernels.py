"""What one particle does in Dong, Zhang & Chen 2016."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.sph.kernels import wall_pressure, wall_sum
from refsim.surface_tension.dong_2016 import formulas


@kernel
def density(i, position, mass, neighbours, walls, smoothing, fluid, number_density, density):
    """D(3) rho_i = m_i sum_j W_ij, self included [kg/m^dim]; number density sum_j W_ij where requested [1/m^dim]."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    limit = h * h
    number = kernel_value(type(h)(0), smoothing)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            number += kernel_value(math.sqrt(r2), smoothing)
    if walls is not None:
        number += fluid.rest_density * wall_sum(i, None, position, walls, smoothing, None) / mass[i]
    density[i] = mass[i] * number
    if number_density is not None:
        number_density[i] = number


@kernel
def momentum(
    i, position, velocity, mass, density, pressure, neighbours, walls, smoothing, fluid, viscosity, acceleration
):
    """D(4) and, unless `viscosity` is None, D(5), walls after Akinci 2012; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
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
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            apart = r + tiny
            volume_j = mass[j] / density[j]
            squared_j = volume_j * volume_j
            slope = kernel_slope(r, smoothing)
            f = formulas.hu_adams_pressure_pair(squared, squared_j, own, pressure[j], slope) / apart
            ax += f * dx
            ay += f * dy
            az += f * dz
            if viscosity is not None:
                g = formulas.hu_adams_viscosity_pair(squared, squared_j, viscosity, slope, apart)
                ax += g * (u - velocity[j, 0])
                ay += g * (v - velocity[j, 1])
                az += g * (w - velocity[j, 2])
    m = mass[i]
    ax, ay, az = ax / m, ay / m, az / m
    if walls is not None:
        bx, by, bz = wall_pressure(i, None, position, density, pressure, walls, smoothing, fluid, None)
        ax += bx
        ay += by
        az += bz
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az


@kernel
def tension(
    i, position, mass, density, surface_normal, neighbours, smoothing, molecular_force, normal_correction, acceleration
):
    """D(6) with D(7), and D(9) with D(11), each unless None; added to the acceleration [m/s^2].

    `surface_normal` is h n_i of D(11); the coefficient of the correction contains the factor 1/h.
    """
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    nx, ny, nz = real(0), real(0), real(0)
    if normal_correction is not None:
        nx, ny, nz = surface_normal[i, 0], surface_normal[i, 1], surface_normal[i, 2]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            if molecular_force is not None:
                f = formulas.cohesion_pair(mass[j], r * smoothing.inverse_radius, molecular_force) / (r + tiny)
                ax += f * dx
                ay += f * dy
                az += f * dz
            if normal_correction is not None:
                weight = kernel_value(r, smoothing)
                g = formulas.correction_pair(mass[j], density[i], density[j], weight, normal_correction)
                ax += g * (nx - surface_normal[j, 0])
                ay += g * (ny - surface_normal[j, 1])
                az += g * (nz - surface_normal[j, 2])
    acceleration[i, 0] += ax
    acceleration[i, 1] += ay
    acceleration[i, 2] += az
