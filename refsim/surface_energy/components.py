"""Components of inside nodes by SciPy; `components_cuda` labels them on a CUDA device."""

import numpy as np


def components(blocks, node_state, node_label):
    """The lowest node (dimensionless) of each inside node's component, -1 outside."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    from refsim.sparse_grid.block_search import neighbours_along

    inside = node_state == 1
    node_label[:] = -1
    pairs = []
    for axis in range(3 if blocks.neighbour.shape[1] == 27 else 2):
        other = neighbours_along(blocks, axis)
        joined = np.flatnonzero(inside & (other >= 0))
        joined = joined[inside[other[joined]]]
        pairs.append((joined, other[joined]))
    first, second = (np.concatenate(part) for part in zip(*pairs, strict=True))
    graph = coo_array((np.ones(len(first), np.int8), (first, second)), shape=(len(inside),) * 2)
    count, label = connected_components(graph, directed=False)
    lowest = np.full(count, len(inside), np.int64)
    np.minimum.at(lowest, label, np.arange(len(inside)))
    node_label[inside] = lowest[label[inside]]
