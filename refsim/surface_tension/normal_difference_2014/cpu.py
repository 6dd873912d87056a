"""CPU kernel of the tension by normal differences."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.neighbours.rows import cpu_row
from refsim.surface_tension.normal_difference_2014 import particle


@cpu_kernel
def tension(position, mass, surface_normal, neighbours, smoothing, normal_tension, acceleration):
    """P7; added to the acceleration."""
    for i in prange(acceleration.shape[0]):
        row = cpu_row(neighbours, i)
        a = particle.tension(i, row, position, mass, surface_normal, neighbours.entries, smoothing, normal_tension)
        for c in range(3):
            acceleration[i, c] += a[c]
