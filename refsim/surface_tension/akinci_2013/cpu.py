"""CPU kernels of Akinci et al. 2013."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
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
def adhesion(position, walls, smoothing, fluid, adhesion, acceleration):
    """Adhesion to wall particles; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.adhesion(i, cpu_row(walls, i), position, walls, smoothing, fluid, adhesion)
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
