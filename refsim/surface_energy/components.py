"""Components of inside nodes on a CPU, within blocks, then across their faces; and what is counted there."""

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.sparse_grid.formulas import block_bits
from refsim.surface_energy.kernels import look_up_members

NONE, SOME, ALL = 0, 1, 2  # nodes of a block that are inside


def components(blocks, node_state, node_label):
    """The lowest node (dimensionless) of each inside node's component, -1 outside."""
    inside, one = np.empty(len(blocks.keys), np.uint8), np.empty(1, np.uint8)
    label_block(blocks, node_state, node_label, inside)
    join_blocks(blocks, inside, node_label, one)
    shorten_labels(inside, node_label)


@formula
def lowest(node_label, i):
    """Number (dimensionless) of the node at the end of i's chain of labels, i <- label[i]."""
    while node_label[i] != i:
        i = node_label[i]
    return i


@formula
def join(node_label, i, other):
    """Join the components of two nodes: the label of the higher lowest node becomes the lower one."""
    own, met = lowest(node_label, i), lowest(node_label, other)
    if own != met:
        node_label[max(own, met)] = min(own, met)


@kernel(rows_of="inside")
def label_block(b, blocks, node_state, node_label, inside):
    """Chains of labels to the lowest node of each component within block b, and how many of its nodes are inside."""
    bits = block_bits(blocks)
    low, inside_nodes = 64 * b, 0
    for i in range(low, low + 64):
        node_label[i] = -1
        if node_state[i] == 1:
            inside_nodes += 1
            node_label[i] = i
    inside[b] = NONE if inside_nodes == 0 else (ALL if inside_nodes == 64 else SOME)
    if inside_nodes == 64:
        for i in range(low, low + 64):
            node_label[i] = low
    elif inside_nodes > 0:
        for axis in range(3 if bits == 2 else 2):
            step = 1 << (axis * bits)
            for i in range(low, low + 64):
                if (i // step) % (1 << bits) > 0 and node_label[i] >= 0 and node_label[i - step] >= 0:
                    join(node_label, i, i - step)


@kernel(rows_of="one")
def join_blocks(_, blocks, inside, node_label, one):
    """Joins the components that touch across the faces of blocks, by one thread."""
    bits = block_bits(blocks)
    width, middle = 1 << bits, blocks.neighbour.shape[1] // 2
    for b in range(inside.shape[0]):
        if inside[b] != NONE:
            for axis in range(3 if bits == 2 else 2):
                other = blocks.neighbour[b, middle + (1 if axis == 0 else (3 if axis == 1 else 9))]
                if other >= 0 and inside[other] != NONE:
                    if inside[b] == ALL and inside[other] == ALL:
                        join(node_label, 64 * b, 64 * other)
                    else:
                        step = 1 << (axis * bits)
                        for local in range(64):
                            if (local // step) % width == width - 1:
                                i, j = 64 * b + local, 64 * other + local - (width - 1) * step
                                if node_label[i] >= 0 and node_label[j] >= 0:
                                    join(node_label, i, j)


@kernel(rows_of="inside")
def shorten_labels(b, inside, node_label):
    """Each node of block b takes the last label of its chain, the same while other threads shorten it."""
    if inside[b] != NONE:
        for i in range(64 * b, 64 * b + 64):
            if node_label[i] >= 0:
                node_label[i] = lowest(node_label, i)


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
