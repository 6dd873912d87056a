"""What one particle does in He et al. 2014."""

import math

from refsim.backends.compile import kernel
from refsim.neighbours.rows import row_of
from refsim.smoothing.formulas import kernel_slope, kernel_value
from refsim.sph.kernels import wall_sum
from refsim.surface_tension.he_2014 import formulas


@kernel
def color(i, position, mass, density, neighbours, walls, smoothing, color):
    """c_i = sum_j V_j W_ij + sum_b V_b W_ib, self included; dimensionless."""
    first, stride, count = row_of(neighbours, i)
    h = smoothing.support_radius
    limit = h * h
    total = mass[i] / density[i] * kernel_value(type(h)(0), smoothing)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            total += mass[j] / density[j] * kernel_value(math.sqrt(r2), smoothing)
    if walls is not None:
        total += wall_sum(i, None, position, walls, smoothing, None)
    color[i] = total


@kernel
def squared_gradient(i, position, mass, density, color, neighbours, gradient_smoothing, color_gradient_squared):
    """|grad c_i|^2 with grad c_i = (1/c_i) sum_j V_j c_j grad W_ij [1/m^2]."""
    first, stride, count = row_of(neighbours, i)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    gx, gy, gz = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
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
    color_gradient_squared[i] = gx * gx + gy * gy + gz * gz


@kernel
def tension(
    i, position, mass, density, color_gradient_squared, neighbours, gradient_smoothing, gradient_energy, air_pressure,
    acceleration,
):  # fmt: skip
    """Gradient energy and air pressure, each unless None; added to the acceleration [m/s^2]."""
    first, stride, count = row_of(neighbours, i)
    h = gradient_smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = neighbours.entries[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            slope = kernel_slope(r, gradient_smoothing)
            volume = mass[j] / density[j]
            f = real(0)
            if gradient_energy is not None:
                both = color_gradient_squared[i], color_gradient_squared[j]
                f += formulas.gradient_energy_pair(volume, both[0], both[1], slope, gradient_energy)
            if air_pressure is not None:
                f += formulas.air_pressure_pair(volume, slope, air_pressure)
            f /= r + tiny
            ax += f * dx
            ay += f * dy
            az += f * dz
    rho = density[i]
    acceleration[i, 0] += ax / rho
    acceleration[i, 1] += ay / rho
    acceleration[i, 2] += az / rho
