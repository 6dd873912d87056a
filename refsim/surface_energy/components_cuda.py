"""Components of inside nodes by union-find: every node begins as its own component, and neighbours are joined."""

from refsim.backends.compile import cuda, cuda_formula, formula


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
