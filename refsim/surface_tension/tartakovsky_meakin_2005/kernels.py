"""What one neighbour and one particle do in Tartakovsky & Meakin 2005."""

import math

from refsim.neighbours.forces import force
from refsim.neighbours.pairs import pair
from refsim.smoothing.formulas import safe_distance


@pair
def cosine_pair(r, x_ij, smoothing, cosine_force):
    """F_ij/s = cos(3 pi r/(2 h)) e_ij, dimensionless: repels below h/3 and attracts beyond."""
    f = math.cos(cosine_force.wave_number * r) / safe_distance(r, smoothing)
    return f * x_ij[0], f * x_ij[1], f * x_ij[2]


cosine_cohesion = force(cosine_pair, "cosine_cohesion", times="cosine_force.strength", divided="mass")
