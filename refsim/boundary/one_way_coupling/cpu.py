"""CPU kernels of one-way coupling."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.one_way_coupling import particle
from refsim.neighbours.rows import cpu_row


@cpu_kernel
def wall_viscosity(position, velocity, density, walls, smoothing, fluid, wall_viscosity, acceleration):
    """P6, viscous part; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        a = particle.wall_viscosity(
            i, cpu_row(walls, i), position, velocity, density, walls, smoothing, fluid, wall_viscosity
        )
        for c in range(3):
            acceleration[i, c] += a[c]


@cpu_kernel
def wall_pressure(position, density, pressure, neighbours, walls, smoothing, fluid, wall_gravity, acceleration):
    """P6 with the boundary particles' own pressures; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        row, wall_row = cpu_row(neighbours, i), cpu_row(walls, i)
        a = particle.wall_pressure(
            i, row, wall_row, position, density, pressure, neighbours.entries, walls, smoothing, fluid, wall_gravity
        )
        for c in range(3):
            acceleration[i, c] += a[c]
