"""Embedded points of the surface's samples: sorting by owner, and the launch, on either backend."""

from typing import Any, NamedTuple

import numpy as np

from refsim.mpm.groups import Owned
from refsim.mpm.kernels import embed_samples
from refsim.mpm.sorting import by_owner


class Samples(NamedTuple):
    """Samples of the surface, sorted by owner."""

    position: Any  # (s, 3) [m]
    order: Any  # (s,) numbers by owner
    first: Any  # (n + 1,) place of the first of each owner


def embed(
    position, surface_sample, sample_owner, background, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner, shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    count = position.shape[0]
    if isinstance(sample_owner, np.ndarray):
        order, first = by_owner(sample_owner, count)
    else:
        from refsim.mpm.sorting_cuda import by_owner as by_owner_on_device  # loads numba.cuda

        order, first = by_owner_on_device(sample_owner, count)
    samples, carriers = Samples(surface_sample, order, first), Owned(carrier_position, carrier_owner)
    embed_samples(position, samples, background.cell_size, carriers, carrier_first, cluster_share, inverse_spread)
