"""Solutions with a surface tension: Prosperetti's capillary wave, and the meniscus at a vertical wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray


def prosperetti(time: NDArray, square: float, damping: float, velocity: bool = False) -> NDArray:
    """a(t)/a(0) of a wave of small amplitude on deep viscous liquid, beneath nothing, that starts at rest.

    With `velocity` omega_0 a(t)/a'(0) of one that starts flat, with the velocities of a potential flow.
    square   omega_0^2 = sigma k^3/rho + g k [1/s^2]; damping  nu k^2 [1/s]
    Prosperetti, Phys. Fluids 24 (1981) 1217, eq. (22) with one liquid (beta = 0):
    a = a(0) 4 n^2/(8 n^2 + w) erfc(sqrt(n t))
        + sum_i z_i/Z_i (w a(0)/(z_i^2 - n) - a'(0)) exp((z_i^2 - n) t) erfc(z_i sqrt(t)),
    n = nu k^2, w = omega_0^2, with the four roots of z^4 + 2 n z^2 + 4 n^1.5 z + n^2 + w = 0 and
    Z_i the product of z_j - z_i over the others. exp(z^2 t) erfc(z sqrt(t)) is Faddeeva's function of i z sqrt(t).
    """
    from scipy.special import erfc, wofz

    n, w = damping, square
    roots = np.roots([1.0, 0.0, 2 * n, 4 * n**1.5, n**2 + w])
    found = np.zeros_like(time, dtype=complex)
    if not velocity:
        found += 4 * n**2 / (8 * n**2 + w) * erfc(np.sqrt(n * time))
    for i, z in enumerate(roots):
        share = -math.sqrt(w) if velocity else w / (z**2 - n)
        others = np.prod(np.delete(roots, i) - z)
        found += z / others * share * np.exp(-n * time) * wofz(1j * z * np.sqrt(time))
    return found.real


def meniscus(length: float, angle: float) -> tuple[float, float]:
    """(height [m], area [m^2]) of the liquid that a vertical wall lifts above the level far from it.

    length  sqrt(sigma/(rho g)) [m]; angle  of contact [rad]. Height sqrt(2 (1 - sin angle)) length, negative above 90
    degrees; the wall carries the lifted weight, rho g area = sigma cos(angle) (Landau & Lifshitz 1987, section 61).
    """
    return math.copysign(math.sqrt(2 * (1 - math.sin(angle))), math.cos(angle)) * length, math.cos(angle) * length**2
