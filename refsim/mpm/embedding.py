"""Embedded points of the surface's samples: sorting by owner, and the launch, on either backend."""

import numpy as np

from refsim.mpm.kernels import embed_samples
from refsim.mpm.sorting import by_owner


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
    embed_samples(
        position, surface_sample, order, first, background.cell_size, carrier_first, carrier_position, carrier_owner,
        cluster_share, inverse_spread,
    )  # fmt: skip
