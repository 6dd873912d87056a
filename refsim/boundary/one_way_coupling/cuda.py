"""CUDA kernels of one-way coupling."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.boundary.one_way_coupling import particle
from refsim.neighbours.rows import cuda_row


@cuda_kernel
def wall_viscosity(position, velocity, density, walls, smoothing, fluid, wall_viscosity, acceleration):
    """P6, viscous part; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        a = particle.wall_viscosity(
            i, cuda_row(walls, i), position, velocity, density, walls, smoothing, fluid, wall_viscosity
        )
        for c in range(3):
            acceleration[i, c] += a[c]


@cuda_kernel
def wall_pressure(position, density, pressure, neighbours, walls, smoothing, fluid, wall_gravity, acceleration):
    """P6 with the boundary particles' own pressures; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        row, wall_row = cuda_row(neighbours, i), cuda_row(walls, i)
        a = particle.wall_pressure(
            i, row, wall_row, position, density, pressure, neighbours.entries, walls, smoothing, fluid, wall_gravity
        )
        for c in range(3):
            acceleration[i, c] += a[c]
