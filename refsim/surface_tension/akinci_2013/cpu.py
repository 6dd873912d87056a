"""CPU kernels of Akinci et al. 2013."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.sph.particle import wall_pressure
from refsim.surface_tension.akinci_2013 import particle


@cpu_kernel
def tension(position, mass, density, area_normal, neighbours, smoothing, fluid, spline, area_term, acceleration):
    """Cohesion and area term with K_ij; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.tension(
            i, cpu_row(neighbours, i), position, mass, density, area_normal, neighbours.entries, smoothing, fluid,
            spline, area_term,
        )  # fmt: skip
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def momentum(
    position, velocity, mass, density, pressure, area_normal, neighbours, walls, gradient_smoothing, fluid, viscosity,
    spline, area_term, acceleration,
):  # fmt: skip
    """Cohesion and area term, J(10) and J(11), walls after Akinci 2012; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.momentum(
            i, cpu_row(neighbours, i), position, velocity, mass, density, pressure, area_normal, neighbours.entries,
            gradient_smoothing, fluid, viscosity, spline, area_term,
        )  # fmt: skip
        if walls is not None:
            bx, by, bz = wall_pressure(
                i, cpu_row(walls, i), position, density, pressure, walls, gradient_smoothing, fluid
            )
            ax += bx
            ay += by
            az += bz
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az


@cpu_kernel
def adhesion(position, walls, smoothing, fluid, adhesion, acceleration):
    """Adhesion to wall particles; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.adhesion(i, cpu_row(walls, i), position, walls, smoothing, fluid, adhesion)
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
