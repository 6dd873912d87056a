"""Strength of the friction at wall particles with which liquid does not slip. Lengths in spacings d.

The friction is a viscosity along the line of centres times (1 - r/h)^n. So it grows towards the wall as that of a layer
in shear, and ten layers flow as Poiseuille says to 0.5 % (h = 2.6 d and more); with n = 0 it is 4 to 8 % more.
"""

import functools
import math

import numpy as np

from refsim.smoothing import lattice, smoothing
from refsim.sph.shear import SHORTEST, layer_friction

STEEPNESS = {True: 3, False: 1}  # n where the liquid's viscosity is along the line of centres, and beside J(11)
NEAR, RESOLVED = 0.75, 0.9  # spacings off the first layer; step over the time in which friction stops a particle there


def _padded(volumes: tuple[float, ...], far: int) -> list[float]:
    """Volumes of `far` layers of the wall; 1 for whole cells."""
    return [*volumes, *[0.0] * far][:far] if volumes else [1.0] * far


@functools.lru_cache(maxsize=64)
def holding_share(reach: float, dim: int, central: bool, volumes: tuple[float, ...] = ()) -> float:
    """Coefficient of the friction over that of the liquid's viscosity [-], with which a sheared lattice does not slip.

    reach    support radius [d]
    central  whether that viscosity is along the line of centres, with (dim + 2) mu, or J(11), over (dim + 2)
    volumes  of the wall's layers over those of the lattice; () for whole cells
    """
    from scipy.optimize import brentq

    liquid, wall = (layer_friction(reach, dim, *form) for form in ((central,), (True, STEEPNESS[central])))
    far = len(wall)
    rows, volume = 12 * far, _padded(volumes, far)
    between, held = np.zeros((rows, rows)), np.zeros(rows)
    for k, friction in enumerate(liquid, 1):
        between += friction * (np.eye(rows, k=k) + np.eye(rows, k=-k))
    between -= np.diag(between.sum(1))
    for i in range(far):
        held[i] = sum(wall[i + j] * volume[j] for j in range(far - i))
    height, sheared = np.arange(rows) + 0.5, np.arange(rows) >= rows - far
    between[sheared] = np.eye(rows)[sheared]

    def slip(share: float) -> float:
        """Where the velocity of the middle layers, which shear uniformly, vanishes below the wall."""
        velocity = np.linalg.solve(between - share * np.diag(held), np.where(sheared, height, 0.0))
        i = rows // 2
        return float(velocity[i] / (velocity[i + 1] - velocity[i]) - height[i])

    return float(brentq(slip, 1e-2, 1e6, rtol=1e-10))


@functools.lru_cache(maxsize=64)
def holding_rate(reach: float, dim: int, central: bool, volumes: tuple[float, ...] = ()) -> float:
    """Rate [k/(rho d^2)] at which friction of coefficient k stops a particle on its way to the wall, `NEAR` off its
    first layer."""
    from refsim.smoothing.reference import viscosity_laplacian

    reach = max(reach, SHORTEST)
    far = math.ceil(reach)
    beside, kernel = (lattice(far, dim - 1) ** 2).sum(1), smoothing("wendland_c2", reach, dim)
    rate = 0.0
    for j, volume in enumerate(_padded(volumes, far)):
        away = j + NEAR
        r = np.sqrt(beside + away**2)
        shape = viscosity_laplacian(r, kernel) * np.maximum(1 - r / reach, 0) ** STEEPNESS[central]
        rate += volume * float((shape * (away / r) ** 2).sum())
    return rate
