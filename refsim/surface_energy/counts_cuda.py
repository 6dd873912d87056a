"""Samples of each particle, and particles of each component, counted by atomic additions of integers."""

import numpy as np

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.surface_energy.counts import look_up_members


def sample_counts(nearest, sample_count):
    """C_p (dimensionless): samples of each particle."""
    device.fill(sample_count, 0)
    count_samples(nearest, sample_count)


@cuda_kernel(rows_of="nearest")
def count_samples(nearest, sample_count):
    """Adds 1 for the nearest particle of each sample; a sum of integers does not depend on its order."""
    s = cuda.grid(1)
    if s < nearest.shape[0] and nearest[s] >= 0:
        cuda.atomic.add(sample_count, nearest[s], 1)


def component_sizes(cells, node_label, component_size):
    """Number (dimensionless) of particles in the component of each particle."""
    held = device.empty(node_label.shape[0], np.int32)
    device.fill(held, 0)
    count_members(cells.cell, node_label, held)
    look_up_members(cells.cell, node_label, held, component_size)


@cuda_kernel(rows_of="cell")
def count_members(cell, node_label, held):
    """Particles of each component, at its lowest node."""
    p = cuda.grid(1)
    if p < cell.shape[0] and cell[p] >= 0 and node_label[cell[p]] >= 0:
        cuda.atomic.add(held, node_label[cell[p]], 1)
