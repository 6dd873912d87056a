"""Components of inside nodes by union-find: every node begins as its own component, and neighbours are joined."""

from refsim.backends.compile import cuda, cuda_formula, cuda_kernel, formula
from refsim.sparse_grid.formulas import step_node


def components(blocks, node_state, node_label):
    """The lowest node (dimensionless) of each inside node's component, -1 outside."""
    begin_labels(node_state, node_label)
    join_labels(blocks, node_label)
    shorten_labels(node_label)


@cuda_kernel
def begin_labels(node_state, node_label):
    """Each inside node is its own component."""
    i = cuda.grid(1)
    if i < node_label.shape[0]:
        node_label[i] = i if node_state[i] == 1 else -1


@formula
def lowest(node_label, i):
    """Number (dimensionless) of the node at the end of i's chain of labels, i <- label[i]."""
    label = node_label[i]
    while label != i:
        i, label = label, node_label[label]
    return i


@formula
def shortened(node_label, i):
    """`lowest`, while nothing but joins changes labels: each node on the way takes the label of its label."""
    label = node_label[i]
    while label != i:
        after = node_label[label]
        if after != label:
            node_label[i] = after
        i, label = label, after
    return i


@cuda_formula
def join(node_label, i, other):
    """Join the components of two nodes: the label of the higher lowest node becomes the lower one.

    Labels only decrease, and a chain that another thread has just lengthened still leads into the same component. A
    join that finds its label changed is tried again from there.
    """
    own, met = shortened(node_label, i), shortened(node_label, other)
    while own != met:
        high, low = max(own, met), min(own, met)
        found = cuda.atomic.cas(node_label, high, high, low)
        if found == high:
            break
        own, met = shortened(node_label, found), shortened(node_label, low)


@cuda_kernel
def join_labels(blocks, node_label):
    """Joins the components of inside nodes that are neighbours along an axis."""
    i = cuda.grid(1)
    if i < node_label.shape[0] and node_label[i] >= 0:
        for axis in range(3 if blocks.neighbour.shape[1] == 27 else 2):
            other = step_node(blocks, i, 1 if axis == 0 else 0, 1 if axis == 1 else 0, 1 if axis == 2 else 0)
            if other >= 0 and node_label[other] >= 0:
                join(node_label, i, other)


@cuda_kernel
def shorten_labels(node_label):
    """Each node takes the last label of its chain."""
    i = cuda.grid(1)
    if i < node_label.shape[0] and node_label[i] >= 0:
        node_label[i] = lowest(node_label, node_label[i])
