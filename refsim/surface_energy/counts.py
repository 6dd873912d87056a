"""Samples of each particle, and particles of each component, on a CPU."""

import numpy as np

from refsim.backends.compile import kernel


def sample_counts(nearest, sample_count):
    """C_p (dimensionless): samples of each particle."""
    sample_count[:] = np.bincount(nearest[nearest >= 0], minlength=len(sample_count))


def component_sizes(cells, node_label, component_size):
    """Number (dimensionless) of particles in the component of each particle."""
    members = np.zeros(len(node_label), np.int32)
    count_members(cells.first, node_label, members, np.empty(1, np.uint8))
    look_up_members(cells.cell, node_label, members, component_size)


@kernel(rows_of="one")
def count_members(_, first, node_label, members, one):
    """Particles of each component, at its lowest node, by one thread."""
    for i in range(node_label.shape[0]):
        if node_label[i] >= 0:
            members[node_label[i]] += first[i + 1] - first[i]


@kernel
def look_up_members(p, cell, node_label, members, component_size):
    """Particles in the component of each particle."""
    i = cell[p]
    component_size[p] = members[node_label[i]] if i >= 0 and node_label[i] >= 0 else 0
