"""Embedded points of the surface's samples, sorted by owner, on a CPU."""

from collections import namedtuple

import numpy as np

from refsim.mpm.groups import Owned
from refsim.mpm.kernels import embed_samples

# Samples of the surface (s, 3) [m], their numbers (s,) by owner, and the place (n + 1,) of the first of each owner
Samples = namedtuple("Samples", "position order first")


def by_owner(sample_owner, count):
    """(numbers of the samples by owner, place of the first of each owner and the total), int32, stable."""
    order = np.argsort(sample_owner, kind="stable").astype(np.int32)
    first = np.zeros(count + 1, np.int32)
    np.cumsum(np.bincount(sample_owner, minlength=count), out=first[1:])
    return order, first


def embed(
    position, surface_sample, sample_owner, background, scratch, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner, shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    order, first = by_owner(sample_owner, position.shape[0])
    samples, carriers = Samples(surface_sample, order, first), Owned(carrier_position, carrier_owner)
    embed_samples(position, samples, background.cell_size, carriers, carrier_first, cluster_share, inverse_spread)
