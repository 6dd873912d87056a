"""What one neighbour and one particle do in Tartakovsky & Meakin 2005."""

import math

from refsim.backends.compile import kernel
from refsim.backends.tuples import scaled
from refsim.neighbours.pairs import neighbour_sum, pair
from refsim.neighbours.rows import add_vector
from refsim.smoothing.formulas import safe_distance


@pair
def cosine_pair(r, x_ij, smoothing, cosine_force):
    """F_ij/s = cos(3 pi r/(2 h)) e_ij, dimensionless: repels below h/3 and attracts beyond."""
    f = math.cos(cosine_force.wave_number * r) / safe_distance(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


@kernel(lanes=True)
def cosine_cohesion(i, lane, position, mass, neighbours, smoothing, cosine_force, acceleration):
    """Pair force s cos(3 pi r/(2 h)) e_ij over m_i; added to the acceleration [m/s^2]."""
    a = neighbour_sum(cosine_pair, i, lane, neighbours, position, None, smoothing, cosine_force)
    strength = cosine_force.strength / mass[i]
    add_vector(acceleration, i, lane, scaled(a, strength))
