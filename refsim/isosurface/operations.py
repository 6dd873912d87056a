"""Operations of isosurfaces: cells of all nodes at once."""

import numpy as np

from refsim.core.operation import operations
from refsim.isosurface import reference as ref
from refsim.sparse_grid.reference import Lookup, dimension

operation = operations(paper="Lorensen & Cline 1987")


def exactly(**outputs):
    """Integers that are compared exactly, dimensionless."""
    return {name: (value, np.full(np.shape(value), np.inf)) for name, value in outputs.items()}


@operation(
    "states of a cell's corners", outputs="crossings cell_case", exact="crossings cell_case", tolerance=0.0,
    reason="integers",
)  # fmt: skip
def classify(blocks, node_state):
    """Cut edges and corner states of each node's cell, dimensionless; a corner without a node is unknown (2)."""
    dim, find = dimension(blocks), Lookup(blocks)
    corner = find(find.coordinates[:, None, :] + ref.corner_places(dim))
    states = np.append(np.asarray(node_state, dtype=int), 2)[corner]
    return exactly(crossings=ref.crossings(states, dim), cell_case=ref.case(states))


@operation(
    "table of cases; inside corners that are diagonal on a face are separate", outputs="vertex_edge facets",
    exact="vertex_edge facets", tolerance=0.0, reason="integers",
)  # fmt: skip
def facets(blocks, crossings, cell_case, edge_first, facet_first, table):
    """Edge 3 i + a of each vertex, and vertices of each facet, dimensionless numbers.

    Of the table only `merged` is used: whether cells with more than four corners inside take their complement's facets.
    """
    dim, find = dimension(blocks), Lookup(blocks)
    cell_case = np.asarray(cell_case, dtype=int)
    node, axis = np.nonzero(np.asarray(crossings, dtype=int)[:, None] >> np.arange(3) & 1)
    vertex = {int(e): v for v, e in enumerate(3 * node + axis)}
    last, edges, place = 2 ** (2**dim) - 1, ref.cell_edges(dim), ref.corner_places(dim)
    rows = []
    for i in np.flatnonzero((cell_case > 0) & (cell_case < last)):
        case = int(cell_case[i])
        turned = table.merged and case.bit_count() > 2 ** (dim - 1)
        for facet in ref.cell_facets(last - case if turned else case, dim):
            facet = facet[::-1] if turned else facet
            lower = find(find.coordinates[i] + place[[edges[e][0] for e in facet]])
            rows.append([vertex[3 * int(n) + edges[e][1]] for n, e in zip(lower, facet, strict=True)])
    return exactly(vertex_edge=3 * node + axis, facets=np.array(rows, dtype=int).reshape(-1, dim))


@operation(
    "linear crossing of an edge", outputs="vertex_position", entrywise=True,
    reason="one rounding in each of the two differences, the quotient, the sum and the product",
)  # fmt: skip
def edge_points(blocks, node_value, contour, vertex_edge):
    """Vertices [m] on their edges; both differences of the share are rounded relative to the values."""
    find, value = Lookup(blocks), np.asarray(node_value, dtype=float)
    node, axis = np.divmod(np.asarray(vertex_edge, dtype=int), 3)
    way, start = np.eye(3, dtype=int)[axis], find.coordinates[node]
    low, high = value[node], value[find(start + way)]
    h, level = float(contour.cell_size), float(contour.level)
    loose = (np.abs(low) + np.abs(high) + abs(level)) / np.abs(high - low)
    position = ref.crossing_point(h, start, way, ref.share(level, low, high)[:, None])
    return {"vertex_position": (position, h * (np.abs(start) + 1 + loose[:, None] * way))}
