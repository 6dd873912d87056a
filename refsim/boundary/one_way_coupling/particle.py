"""What one particle does at boundary particles; the CPU and the CUDA kernels share the loop."""

import math

from refsim.boundary.one_way_coupling.formulas import wall_viscosity_pair
from refsim.compile import formula
from refsim.smoothing.formulas import viscosity_laplacian


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
