"""What one particle does in He et al. 2014; the CPU and the CUDA kernels share these loops.

`row` is (first, stride, count) of the particle's neighbours in `index`; the wall's row likewise.
"""

import math

from refsim.backends.compile import formula
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.surface_tension.he_2014 import formulas


@formula
def color(i, row, position, mass, density, index, smoothing):
    """c_i = sum_j V_j W_ij over the fluid, self included; dimensionless."""
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    total = mass[i] / density[i] * kernel_value(type(h)(0), smoothing)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            total += mass[j] / density[j] * kernel_value(math.sqrt(r2), smoothing)
    return total


@formula
def squared_gradient(i, row, position, mass, density, color, index, gradient_smoothing):
    """|grad c_i|^2 with grad c_i = (1/c_i) sum_j V_j c_j grad W_ij [1/m^2]."""
    first, stride, count = row
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    gx, gy, gz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, gradient_smoothing)
            f = formulas.color_gradient_pair(mass[j] / density[j], color[j], slope) / (r + tiny)
            gx += f * dx
            gy += f * dy
            gz += f * dz
    c = color[i]
    gx, gy, gz = gx / c, gy / c, gz / c
    return gx * gx + gy * gy + gz * gz


@formula
def tension(
    i, row, position, mass, density, color_gradient_squared, index, gradient_smoothing, surface_energy, air_pressure
):
    """Surface energy and air pressure, each unless None: acceleration of particle i [m/s^2]."""
    first, stride, count = row
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, gradient_smoothing)
            volume = mass[j] / density[j]
            f = real(0)
            if surface_energy is not None:
                both = color_gradient_squared[i], color_gradient_squared[j]
                f += formulas.surface_energy_pair(volume, both[0], both[1], slope, surface_energy)
            if air_pressure is not None:
                f += formulas.air_pressure_pair(volume, slope, air_pressure)
            f /= r + tiny
            ax += f * dx
            ay += f * dy
            az += f * dz
    rho = density[i]
    return ax / rho, ay / rho, az / rho
