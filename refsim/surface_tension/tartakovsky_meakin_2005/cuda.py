"""CUDA kernel of Tartakovsky & Meakin 2005."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_row
from refsim.surface_tension.tartakovsky_meakin_2005 import particle


@cuda_kernel
def cosine_cohesion(position, mass, neighbours, smoothing, cosine_force, acceleration):
    """Pair force s cos(3 pi r/(2 h)) e_ij; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        ax, ay, az = particle.cosine_cohesion(
            i, cuda_row(neighbours, i), position, mass, neighbours.entries, smoothing, cosine_force
        )
        acceleration[i, 0] += ax
        acceleration[i, 1] += ay
        acceleration[i, 2] += az
