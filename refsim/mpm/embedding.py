"""Embedded points of the surface's samples: sorting by owner, and the launch, on either backend."""

import numpy as np

from refsim.mpm.kernels import embed_samples


def embed(
    position, surface_sample, sample_owner, background, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner, shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    order, first = _by_owner(sample_owner, position.shape[0])
    embed_samples(
        position, surface_sample, order, first, background.cell_size, carrier_first, carrier_position, carrier_owner,
        cluster_share, inverse_spread,
    )  # fmt: skip


def _by_owner(sample_owner, count):
    """(numbers of the samples by owner, place of the first of each owner and the total), int32, stable."""
    if isinstance(sample_owner, np.ndarray):
        first = np.zeros(count + 1, np.int32)
        first[1:] = np.cumsum(np.bincount(sample_owner, minlength=count))
        return np.argsort(sample_owner, kind="stable").astype(np.int32), first
    from refsim.backends import device

    xp, owner = device.library(), device.seen(sample_owner)
    order = xp.argsort(owner, kind="stable").astype(np.int32) if len(owner) else xp.zeros(0, np.int32)
    first = xp.searchsorted(owner[order], xp.arange(count + 1, dtype=np.int32)).astype(np.int32)
    return device.wrapped(order), device.wrapped(first)
