"""CUDA kernel of the tension by normal differences."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.neighbours.rows import cuda_row
from refsim.surface_tension.normal_difference_2014 import particle


@cuda_kernel
def tension(position, mass, surface_normal, neighbours, smoothing, normal_tension, acceleration):
    """P7; added to the acceleration."""
    i = cuda.grid(1)
    if i < acceleration.shape[0]:
        row = cuda_row(neighbours, i)
        a = particle.tension(i, row, position, mass, surface_normal, neighbours.entries, smoothing, normal_tension)
        for c in range(3):
            acceleration[i, c] += a[c]
