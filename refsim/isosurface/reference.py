"""NumPy oracle of isosurfaces: cells of all nodes at once, polygons followed edge by edge, no table.

Each function returns {output: (value, scale)}; integers have the scale infinity: they are compared exactly.
"""

import math

import numpy as np

from refsim.core.operation import operations
from refsim.sparse_grid.reference import Lookup, dimension

operation = operations(paper="Lorensen & Cline 1987")


def _corner_states(blocks, node_state):
    """(nodes, 2^dim) states of each cell's corners, 2 where there is no node; corner c stands at its bits."""
    dim = dimension(blocks)
    find = Lookup(blocks)
    bits = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(2**dim)])
    corner = find(find.coordinates[:, None, :] + bits[None])
    known = np.append(np.asarray(node_state, dtype=int), 2)
    return known[corner]


@operation(
    "states of a cell's corners", outputs="crossings cell_case", exact="crossings cell_case", tolerance=0.0,
    reason="integers",
)  # fmt: skip
def classify(blocks, node_state):
    """Cut edges and corner states (dimensionless): bits 1 <- state_0 + state_a = 1; case = sum_c state_c 2^c.

    A cell of which a corner is unknown (2) or missing has case 0.
    """
    states = _corner_states(blocks, node_state)
    count = states.shape[1]
    case = np.where((states < 2).all(1), (states * 2 ** np.arange(count)).sum(1), 0)
    pairs = states[:, [1, 2, 4][: count.bit_length() - 1]]
    cut = (pairs + states[:, :1] == 1) & (pairs < 2) & (states[:, :1] < 2)
    crossings = (cut * 2 ** np.arange(cut.shape[1])).sum(1)
    sure = np.full(len(case), np.inf)
    return {"crossings": (crossings, sure), "cell_case": (case, sure)}


def _edges(dim):
    return [(c, a) for a in range(dim) for c in range(2**dim) if not c >> a & 1]


def polygons(case, dim):
    """Oriented polygons of one cell as tuples of edges, found by going round the faces of each inside corner.

    On a square face a point on edge e is joined to the one on the other cut edge at e's inside corner's side: the
    segment from e separates e's inside corner, and those joined to it along the face's rim, from the others.
    """
    edges = _edges(dim)
    place = [np.array([(c >> b & 1) + (0.5 if b == a else 0.0) for b in range(3)]) for c, a in edges]
    inside = [bool(case >> c & 1) for c in range(2**dim)]
    cut = [e for e, (c, a) in enumerate(edges) if inside[c] != inside[c | 1 << a]]
    arrows = {}
    for axis, side in [(2, 0)] if dim == 2 else [(axis, side) for axis in range(3) for side in (0, 1)]:
        on_face = [c for c in range(2**dim) if c >> axis & 1 == side]
        outward = np.zeros(3)
        outward[axis] = 1.0 if dim == 2 else 2.0 * side - 1.0
        groups = []  # inside corners of this face, joined along its rim
        for c in on_face:
            if inside[c]:
                near = [g for g in groups if any(bin(c ^ o).count("1") == 1 for o in g)]
                groups = [g for g in groups if g not in near] + [sum(near, [c])]
        for group in groups:
            ends = [e for e in cut if {edges[e][0], edges[e][0] | 1 << edges[e][1]} <= set(on_face)]
            ends = [e for e in ends if {edges[e][0], edges[e][0] | 1 << edges[e][1]} & set(group)]
            if not ends:
                continue
            a, b = ends
            middle = np.mean([[c & 1, c >> 1 & 1, c >> 2] for c in group], axis=0)
            towards = np.cross(place[b] - place[a], outward) @ (middle - place[a])
            if (towards < 0) != (dim == 2):
                a, b = b, a
            arrows[a] = b
    if dim == 2:
        return [(a, b) for a, b in sorted(arrows.items(), key=lambda arrow: arrow[1])]
    found = []
    for start in sorted(arrows):
        if any(start in loop for loop in found):
            continue
        loop = [start]
        while arrows[loop[-1]] != start:
            loop.append(arrows[loop[-1]])
        found.append(tuple(loop))
    return found


_FACETS = {}


def cell_facets(case, dim):
    """Facets of one cell, computed once."""
    if (case, dim) not in _FACETS:
        _FACETS[case, dim] = _cell_facets(case, dim)
    return _FACETS[case, dim]


def _cell_facets(case, dim):
    """Facets of one cell: polygons cut by ears so that no diagonal lies in a face and the sum of the diagonals' squares
    is least; of equal ways the first when sorted."""
    if dim == 2:
        return polygons(case, dim)
    edges = _edges(3)
    middle = {e: [(c >> b & 1) + 0.5 * (b == a) for b in range(3)] for e, (c, a) in enumerate(edges)}

    def share_face(e, f):
        points = [[c >> b & 1 for b in range(3)] for k in (e, f) for c in (edges[k][0], edges[k][0] | 1 << edges[k][1])]
        return any(len({p[b] for p in points}) == 1 for b in range(3))

    def ways(loop):
        """Sets of triangles."""
        if len(loop) == 3:
            return {frozenset([loop])}
        found = set()
        for k in range(len(loop)):
            ear = (loop[k - 1], loop[k], loop[(k + 1) % len(loop)])
            if not share_face(ear[0], ear[2]):
                rest = ways(loop[:k] + loop[k + 1 :])
                found |= {way | {ear} for way in rest}
        return found

    def pairs(triangle):
        return [tuple(sorted((triangle[k - 1], triangle[k]))) for k in range(3)]

    def turned(triangle):
        k = triangle.index(min(triangle))
        return triangle[k:] + triangle[:k]

    result = []
    for loop in polygons(case, dim):
        rim = {frozenset((loop[k - 1], loop[k])) for k in range(len(loop))}
        best = min(
            (
                sum(
                    round(4 * math.dist(middle[a], middle[b]) ** 2)
                    for a, b in {pair for t in way for pair in pairs(t)}
                    if frozenset((a, b)) not in rim
                ),
                sorted(turned(t) for t in way),
            )
            for way in ways(loop)
        )
        result += best[1]
    return result


@operation(
    "table of cases; inside corners that are diagonal on a face are separate", outputs="vertex_edge facets",
    exact="vertex_edge facets", tolerance=0.0, reason="integers",
)  # fmt: skip
def facets(blocks, crossings, cell_case, edge_first, facet_first, table):
    """Edge 3 i + a of each vertex, vertices of each facet = v(edges of the case); dimensionless numbers.

    Of the table only `merged` is used: whether cells with more than four corners inside take their complement's facets.
    """
    dim = dimension(blocks)
    find = Lookup(blocks)
    crossings, cell_case = np.asarray(crossings, dtype=int), np.asarray(cell_case, dtype=int)
    nodes, axes = np.nonzero(crossings[:, None] >> np.arange(3) & 1)
    vertex_edge = 3 * nodes + axes
    vertex = {int(e): v for v, e in enumerate(vertex_edge)}
    states = 2 ** (2**dim)
    edges = _edges(dim)
    rows = []
    for i in np.flatnonzero((cell_case > 0) & (cell_case < states - 1)):
        case = int(cell_case[i])
        if table.merged and case.bit_count() > 2 ** (dim - 1):
            own = [facet[::-1] for facet in cell_facets(states - 1 - case, dim)]
        else:
            own = cell_facets(case, dim)
        for facet in own:
            lower = [find.coordinates[i] + [edges[e][0] >> b & 1 for b in range(3)] for e in facet]
            at = find(np.array(lower))
            rows.append([vertex[3 * int(n) + edges[e][1]] for n, e in zip(at, facet, strict=True)])
    value = np.array(rows, dtype=int).reshape(-1, dim)
    return {
        "vertex_edge": (vertex_edge, np.full(len(vertex_edge), np.inf)),
        "facets": (value, np.full(value.shape, np.inf)),
    }


@operation(
    "linear crossing of an edge", outputs="vertex_position", entrywise=True,
    reason="one rounding in each of the two differences, the quotient, the sum and the product",
)  # fmt: skip
def edge_points(blocks, node_value, contour, vertex_edge):
    """Vertices x = h (j + t e_a) [m], t = (c - f0)/(f1 - f0) with the values at the edge's ends."""
    find = Lookup(blocks)
    edge = np.asarray(vertex_edge, dtype=int)
    node, axis = np.divmod(edge, 3)
    way = np.eye(3, dtype=int)[axis]
    start = find.coordinates[node]
    value = np.asarray(node_value, dtype=float)
    low, high = value[node], value[find(start + way)]
    share = (float(contour.level) - low) / (high - low)
    position = float(contour.cell_size) * (start + share[:, None] * way)
    # conditioning of the share: both differences are rounded relative to the values
    loose = (np.abs(low) + np.abs(high) + abs(float(contour.level))) / np.abs(high - low)
    scale = float(contour.cell_size) * (np.abs(start) + 1 + loose[:, None] * way)
    return {"vertex_position": (position, scale)}
