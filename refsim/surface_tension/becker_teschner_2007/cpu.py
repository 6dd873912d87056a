"""CPU kernel of Becker & Teschner 2007."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.surface_tension.becker_teschner_2007 import particle


@cpu_kernel
def cohesion(position, mass, neighbours, smoothing, attraction, acceleration):
    """Attraction -kappa m_j/m_i W(r) x_ij; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        ax, ay, az = particle.cohesion(
            i, cpu_row(neighbours, i), position, mass, neighbours.entries, smoothing, attraction
        )
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
