"""Scalar formula of Tartakovsky & Meakin 2005."""

import math

from refsim.backends.compile import formula


@formula
def force_shape(r, cosine_force):
    """cos(3 pi r/(2 h)), dimensionless: F_ij = s cos(3 pi r/(2 h)) e_ij [N] repels below h/3 and attracts beyond."""
    return math.cos(cosine_force.wave_number * r)
