"""Embedded points of the surface's samples, sorted by owner, on a GPU and without the host."""

import math

from refsim.backends import device
from refsim.mpm.groups import Owned, Samples
from refsim.mpm.kernels import embed_samples
from refsim.sparse_grid.block_search_cuda import begin_lists, count_points, fill_lists, lists_of


def embed(
    position, surface_sample, sample_owner, background, scratch, carrier_first, carrier_position, carrier_owner,
    cluster_share, inverse_spread,
):  # fmt: skip
    """Embedded points [m] by owner (-1: none, NaN at the end), shares w = 1/(2 C + 1) and E^-1 of the clusters."""
    lists = lists_of(scratch.called("owners"), position.shape[0], sample_owner.shape[0])
    begin_lists(lists.first, lists.held)
    count_points(sample_owner, lists.held, lists.place)
    fill_lists(sample_owner, lists)
    device.fill(carrier_position, math.nan)
    samples, carriers = Samples(surface_sample, lists.point, lists.first), Owned(carrier_position, carrier_owner)
    embed_samples(position, samples, background.cell_size, carriers, carrier_first, cluster_share, inverse_spread)
