"""What shear feels of a viscosity: friction between layers of a lattice that slide along each other.

A layer meets another at every offset in turn, so that its friction is the mean over them. In channels and shear waves
particles keep their layers and deliver this viscosity to 0.5 %; those that mix, in vortices, 1 % more (h = 3.2 d).
"""

import functools
import math

import numpy as np

from refsim.smoothing import smoothing

SHORTEST = 1.7  # spacings of the support radius from which on the friction is calibrated; below it falls to nothing


@functools.lru_cache(maxsize=64)
def layer_friction(reach: float, dim: int, central: bool, steepness: int = 0) -> tuple[float, ...]:
    """c_k of layers 1, 2, ... spacings d apart: a particle feels mu/d^2 sum_k c_k (u_k - u), a force per volume.

    reach      support radius [d]
    central    viscosity along the line of centres with the coefficient (dim + 2) mu, not J(11) with mu
    steepness  n of a further factor (1 - r/h)^n
    """
    from refsim.smoothing.reference import viscosity_laplacian

    reach = max(reach, SHORTEST)
    kernel, friction = smoothing("wendland_c2", reach, dim), []
    node, weight = np.polynomial.legendre.leggauss(60)
    rows = range(-math.ceil(reach), math.ceil(reach) + 1) if dim == 3 else (0,)
    for k in range(1, math.ceil(reach) + 1):
        total = 0.0
        for row in rows:
            away = math.hypot(k, row)
            half = math.sqrt(max(reach**2 - away**2, 0.0))
            x = half * node  # along a row of particles
            r = np.hypot(x, away)
            shape = viscosity_laplacian(r, kernel) * np.maximum(1 - r / reach, 0) ** steepness
            along = (dim + 2) * (x / r) ** 2 if central else 1.0
            total += float((shape * along * weight).sum()) * half
        friction.append(total)
    return tuple(friction)


def delivered(reach: float, dim: int) -> float:
    """Viscosity that sliding layers deliver, over that of the viscosity along the line of centres [-]."""
    return sum(c * k * k for k, c in enumerate(layer_friction(reach, dim, True), 1))
