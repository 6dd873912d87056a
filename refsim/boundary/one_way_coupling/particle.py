"""What one particle does at boundary particles; the CPU and the CUDA kernels share the loop."""

import math

from refsim.backends.compile import formula
from refsim.boundary.one_way_coupling.formulas import wall_own_pressure, wall_pressure_pair, wall_viscosity_pair
from refsim.smoothing.formulas import kernel_slope, kernel_value, viscosity_laplacian


@formula
def wall_viscosity(i, row, position, velocity, density, walls, smoothing, fluid, wall_viscosity):
    """P6, viscous part: acceleration of particle i [m/s^2] by boundary particles at rest."""
    first, stride, count = row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    total = real(0)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own = density[i]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            wall_mass = fluid.rest_density * walls.volume[b]
            total += wall_viscosity_pair(wall_mass, own, wall_viscosity, viscosity_laplacian(math.sqrt(r2), smoothing))
    return -total * velocity[i, 0], -total * velocity[i, 1], -total * velocity[i, 2]


@formula
def pressure_around(i, row, position, density, pressure, index, smoothing, gravity):
    """p~_i [Pa]: sum_j W_ij (p_j + rho_j g.(x_i - x_j)) / sum_j W_ij over the liquid, self included."""
    first, stride, count = row
    h = smoothing.support_radius
    limit = h * h
    weights = kernel_value(type(h)(0), smoothing)
    total = weights * pressure[i]
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    for k in range(count):
        j = index[first + k * stride]
        dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            w = kernel_value(math.sqrt(r2), smoothing)
            deeper = gravity.x * dx + gravity.y * dy + gravity.z * dz
            weights += w
            total += w * (pressure[j] + density[j] * deeper)
    return total / weights


@formula
def wall_pressure(i, row, wall_row, position, density, pressure, index, walls, smoothing, fluid, gravity):
    """P6 with p_b: acceleration of particle i [m/s^2] by the boundary particles' own pressures."""
    first, stride, count = wall_row
    h = smoothing.support_radius
    real = type(h)
    limit = h * h
    tiny = real(1e-9) * h
    ax, ay, az = real(0), real(0), real(0)
    if count == 0:
        return ax, ay, az
    around = pressure_around(i, row, position, density, pressure, index, smoothing, gravity)
    x, y, z = position[i, 0], position[i, 1], position[i, 2]
    own = density[i]
    for k in range(count):
        b = walls.entries[first + k * stride]
        dx, dy, dz = x - walls.position[b, 0], y - walls.position[b, 1], z - walls.position[b, 2]
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            r = math.sqrt(r2)
            pressure_b = wall_own_pressure(around, gravity, dx, dy, dz, fluid)
            wall_mass = fluid.rest_density * walls.volume[b]
            f = wall_pressure_pair(wall_mass, own, pressure_b, kernel_slope(r, smoothing), fluid) / (r + tiny)
            ax += f * dx
            ay += f * dy
            az += f * dz
    return ax, ay, az
