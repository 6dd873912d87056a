"""Scalar formulas of boundary sampling (patent CN104318598A, claim 2: patent P2 to P4)."""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import scaled
from refsim.surface_energy.formulas import hash_word, unit_share


@formula
def repulsion(squared, relaxation):
    """Patent P4: Omega(s) = exp(-s^2/(2 sigma^2)), dimensionless, for the squared distance s^2 [m^2]."""
    return math.exp(-squared * relaxation.inverse_width)


@formula
def hashed_direction(i, j, seed, one):
    """Patent P4: unit vector d_ij = -d_ji, dimensionless, of coincident particles, from the hash of their numbers."""
    low, high = min(i, j), max(i, j)
    z = unit_share(hash_word(low, high, 2 * seed), one)
    z = z + z - one
    turn = unit_share(hash_word(low, high, 2 * seed + 1), one) * type(one)(2 * math.pi)
    away = math.sqrt(max(one - z * z, one - one))
    return scaled((away * math.cos(turn), away * math.sin(turn), z), one if i < j else -one)
