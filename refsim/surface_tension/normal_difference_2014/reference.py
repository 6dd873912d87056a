"""NumPy oracle of the tension by normal differences: all pairs, float64."""

import numpy as np

from refsim.neighbours.reference import other_particles, pair_blocks


def tension(position, mass, surface_normal, smoothing, normal_tension, rows=None):
    """Patent P7: acceleration a_i = -(gamma/m_i) sum_j m_i m_j/((m_i + m_j)/2) (n_i - n_j) [m/s^2].

    As printed the factor is m_i instead of the harmonic mean of the masses.
    position, surface_normal (n, 3) [m], [-]; mass (n,) [kg]. Returns (value, scale).
    """
    mass, normal = np.asarray(mass, dtype=float), np.asarray(surface_normal, dtype=float)
    own = np.arange(len(mass)) if rows is None else np.asarray(rows)
    value, scale = np.zeros((len(own), 3)), np.zeros((len(own), 3))
    for place, _, distance in pair_blocks(position, position, rows):
        i = own[place]
        near = (distance < float(smoothing.support_radius)) & other_particles(place, len(mass), rows)
        shared = mass[i, None] * mass[None, :] / (0.5 * (mass[i, None] + mass[None, :]))
        if normal_tension.printed_mass:
            shared = np.broadcast_to(mass[i, None], shared.shape)
        factor = (float(normal_tension.coefficient) * near * shared / mass[i, None])[..., None]
        value[place] -= (factor * (normal[i, None, :] - normal[None, :, :])).sum(1)
        scale[place] += (factor * (np.abs(normal[i, None, :]) + np.abs(normal[None, :, :]))).sum(1)
    return {"acceleration": (value, scale)}
