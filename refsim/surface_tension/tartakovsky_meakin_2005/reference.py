"""NumPy oracle of Tartakovsky & Meakin 2005: all pairs, float64.

Arrays: position (n, 3); mass (n,); SI units.
"""

import numpy as np

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.reference import Sums, other_particles, pair_blocks


def force_function(r, h):
    """cos(3 pi r/(2 h)) inside the support; dimensionless."""
    r = np.asarray(r, dtype=float)
    return np.where(r < h, np.cos(1.5 * np.pi * r / h), 0.0)


@operation(
    "pair force s cos(3 pi r/(2 h))", "tartakovsky_meakin_2005.cohesion", paper="Tartakovsky & Meakin 2005",
    adds="acceleration", tolerance=12.0,
    reason="one rounding in each of distance, argument, cosine, direction, product and sum",
    invariants=f"{SYMMETRY} linear_momentum angular_momentum", packed="cosine_pair",
)  # fmt: skip
def cosine_cohesion(position, mass, smoothing, cosine_force, rows=None):
    """Acceleration [m/s^2] a_i = (s/m_i) sum_j cos(3 pi r/(2 h)) e_ij.

    The scale adds the argument of the cosine, whose rounding the cosine takes over.
    """
    h = float(smoothing.support_radius)
    mass = np.asarray(mass, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, separation, distance in pair_blocks(position, position, rows):
        unit = separation / np.where(distance > 0, distance, 1.0)[..., None]
        near = (distance < h) & other_particles(place, len(mass), rows)
        factor = near * float(cosine_force.strength) / mass[own[place], None]
        force = force_function(distance, h)
        size = factor * (np.abs(force) + 1.5 * np.pi * distance / h)
        sums.add(place, (factor * force)[..., None] * unit, size[..., None] * np.abs(unit))
    return {"acceleration": sums.total()}
