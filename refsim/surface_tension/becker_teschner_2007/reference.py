"""NumPy oracle of Becker & Teschner 2007: all pairs, float64.

Arrays: position (n, 3); mass (n,); SI units.
"""

import math

import numpy as np

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.reference import Sums, other_particles, pair_blocks


def attraction_function(r, h, dim, least_distance):
    """W(max(r, d), h) [1/m^dim] inside the support, with the cubic spline W."""
    r = np.asarray(r, dtype=float)
    q = np.maximum(r, least_distance) / h
    norm = 40 / (7 * math.pi * h**2) if dim == 2 else 8 / (math.pi * h**3)
    w = norm * np.where(q <= 0.5, 6 * (q**3 - q**2) + 1, 2 * (1 - q) ** 3)
    return np.where((r < h) & (q < 1), w, 0.0)


@operation(
    "surface tension by attraction", paper="Becker & Teschner 2007", adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, kernel, product and sum, and a few in the spline's cubic",
    invariants=SYMMETRY, packed="cohesion_pair",
)  # fmt: skip
def cohesion(position, mass, smoothing, attraction, rows=None):
    """Acceleration [m/s^2] a_i = -(kappa/m_i) sum_j m_j W(max(r, d)) x_ij."""
    h, dim = float(smoothing.support_radius), int(smoothing.dim)
    mass = np.asarray(mass, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        factor = attraction_function(distance, h, dim, float(attraction.least_q) * h) * mass[None, :]
        factor = factor * other_particles(place, len(mass), rows) * float(attraction.kappa)
        sums.add(place, -(factor / mass[own[place], None])[..., None] * separation)
    return {"acceleration": sums.total()}
