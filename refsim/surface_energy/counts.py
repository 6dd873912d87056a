"""Samples of each particle, and particles of each component, on a CPU."""

import numpy as np


def sample_counts(nearest, sample_count):
    """C_p (dimensionless): samples of each particle."""
    sample_count[:] = np.bincount(nearest[nearest >= 0], minlength=len(sample_count))


def component_sizes(cells, node_label, component_size):
    """Number (dimensionless) of particles in the component of each particle."""
    label = np.where(cells.cell >= 0, node_label[cells.cell], -1)
    members = np.bincount(label[label >= 0], minlength=len(node_label))
    component_size[:] = np.where(label >= 0, members[label], 0)
