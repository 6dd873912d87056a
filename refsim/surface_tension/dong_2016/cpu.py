"""CPU kernels of Dong, Zhang & Chen 2016."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.kernels import wall_pressure, wall_sum
from refsim.surface_tension.dong_2016 import particle


@cpu_kernel
def density(position, mass, neighbours, walls, smoothing, fluid, number_density, density):
    """D(3) rho_i = m_i sum_j W_ij, self included."""
    for i in prange(density.shape[0]):
        number = particle.kernel_sum(i, cpu_row(neighbours, i), position, neighbours.entries, smoothing)
        if walls is not None:
            number += fluid.rest_density * wall_sum(i, position, walls, smoothing) / mass[i]
        density[i] = mass[i] * number
        if number_density is not None:
            number_density[i] = number


@cpu_kernel
def momentum(position, velocity, mass, density, pressure, neighbours, walls, smoothing, fluid, viscosity, acceleration):
    """D(4) and D(5), walls after Akinci 2012; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.momentum(
            i,
            cpu_row(neighbours, i),
            position,
            velocity,
            mass,
            density,
            pressure,
            neighbours.entries,
            smoothing,
            viscosity,
        )
        if walls is not None:
            bx, by, bz = wall_pressure(i, position, density, pressure, walls, smoothing, fluid)
            ax += bx
            ay += by
            az += bz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def tension(
    position, mass, density, surface_normal, neighbours, smoothing, molecular_force, normal_difference, acceleration
):
    """D(6) with D(7), D(9) with D(11); added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.tension(
            i, cpu_row(neighbours, i), position, mass, density, surface_normal, neighbours.entries, smoothing,
            molecular_force, normal_difference,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
