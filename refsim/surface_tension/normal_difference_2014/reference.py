"""NumPy oracle of the tension by normal differences: all pairs, float64."""

import numpy as np

from refsim.core.operation import SYMMETRY, operation
from refsim.neighbours.reference import Sums, other_particles, pair_blocks


@operation(
    "patent P7 with symmetric masses", paper="patent CN104318598A, 2014", adds="acceleration",
    variants=("", {"normal_tension": "as_printed"}), tolerance=8.0,
    reason="one rounding in each of the difference, the mean mass, product and sum; not in the bound: the force does"
    " not vanish at r = h, so that a pair which a rounding moves across r = h changes a by 2 gamma m_j/(m_i + m_j)"
    " |n_i - n_j|, |n_i - n_j| at most 3.2 s (as akinci_2013.tension)", invariants=f"{SYMMETRY} linear_momentum",
    broken={1: "linear_momentum"},
    packed="difference_pair",
)  # fmt: skip
def tension(position, mass, surface_normal, smoothing, normal_tension, rows=None):
    """Patent P7: acceleration a_i = -(gamma/m_i) sum_j m_i m_j/((m_i + m_j)/2) (n_i - n_j) [m/s^2].

    As printed the factor is m_i instead of the harmonic mean of the masses.
    position, surface_normal (n, 3) [m], [-]; mass (n,) [kg]. Returns (value, scale).
    """
    mass, normal = np.asarray(mass, dtype=float), np.asarray(surface_normal, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    sums = Sums(len(own), 3)
    for place, _, distance in pair_blocks(position, position, rows):
        i = own[place]
        near = (distance < float(smoothing.support_radius)) & other_particles(place, len(mass), rows)
        shared = mass[i, None] * mass[None, :] / (0.5 * (mass[i, None] + mass[None, :]))
        if normal_tension.printed_mass:
            shared = np.broadcast_to(mass[i, None], shared.shape)
        factor = (float(normal_tension.coefficient) * near * shared / mass[i, None])[..., None]
        size = factor * (np.abs(normal[i, None, :]) + np.abs(normal[None, :, :]))
        sums.add(place, -factor * (normal[i, None, :] - normal[None, :, :]), size)
    return {"acceleration": sums.total()}
