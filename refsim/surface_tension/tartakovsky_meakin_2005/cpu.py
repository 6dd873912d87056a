"""CPU kernel of Tartakovsky & Meakin 2005."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.surface_tension.tartakovsky_meakin_2005 import particle


@cpu_kernel
def cosine_cohesion(position, mass, neighbours, smoothing, cosine_force, acceleration):
    """Pair force s cos(3 pi r/(2 h)) e_ij; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.cosine_cohesion(
            i, cpu_row(neighbours, i), position, mass, neighbours.entries, smoothing, cosine_force
        )
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
