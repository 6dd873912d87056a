"""What one node, one cell and one vertex do in the extraction of an isosurface."""

from refsim.backends.compile import formula, kernel
from refsim.isosurface.formulas import bits_below, crossing_share, state_at
from refsim.sparse_grid.formulas import block_bits, node_coordinates, step_node


@kernel
def classify(i, blocks, node_state, crossings, cell_case):
    """Cut edges of node i, bit a for axis a, and states of the corners of cell i, as bits; dimensionless.

    A cell with a corner of unknown state counts as outside.
    """
    state = int(node_state[i])
    bits, case = 0, state if state < 2 else -1
    for c in range(1, 8 if block_bits(blocks) == 2 else 4):
        other = state_at(blocks, node_state, i, c & 1, (c >> 1) & 1, c >> 2)
        bits, case = with_corner(c, state, other, bits, case)
    crossings[i] = bits
    cell_case[i] = max(case, 0)


@formula
def with_corner(c, state, other, crossings, case):
    """The two of `classify` with corner c, whose state is `other`; the case is -1 where a state is unknown."""
    if other > 1:
        return crossings, -1
    if (c == 1 or c == 2 or c == 4) and state + other == 1:
        crossings |= c
    return crossings, case | (other << c)


@kernel(rows_of="cell_case")
def facets(i, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets):
    """Numbers of the cut edges of node i, and of the vertices of the facets of cell i; dimensionless."""
    write_edges(i, int(crossings[i]), edge_first[i], vertex_edge)
    write_facets(i, blocks, crossings, cell_case, edge_first, facet_first, table, facets)


@formula
def write_edges(i, bits, at, vertex_edge):
    """vertex_edge <- 3 i + axis for the cut edges of node i, as `bits` says, from row `at` on, where there is room."""
    for axis in range(3):
        if (bits >> axis) & 1 and at < vertex_edge.shape[0]:
            vertex_edge[at] = 3 * i + axis
            at += 1


@formula
def write_facets(i, blocks, crossings, cell_case, edge_first, facet_first, table, facets):
    """facets <- vertices of the facets of cell i."""
    case = int(cell_case[i])
    sides = facets.shape[1]
    for f in range(int(table.count[case])):
        for s in range(sides):
            e = int(table.edge[case, sides * f + s])
            axis = int(table.corner[e, 3])
            lower = step_node(blocks, i, int(table.corner[e, 0]), int(table.corner[e, 1]), int(table.corner[e, 2]))
            facets[facet_first[i] + f, s] = edge_first[lower] + bits_below(int(crossings[lower]), axis)


@kernel
def edge_points(v, blocks, node_value, contour, vertex_edge, vertex_position):
    """Position x = h (j + t e_a) [m] of vertex v, where the value is linear along its edge."""
    h = contour.cell_size
    real = type(h)
    node = vertex_edge[v] // 3
    axis = vertex_edge[v] - 3 * node
    dx, dy, dz = int(axis == 0), int(axis == 1), int(axis == 2)
    jx, jy, jz = node_coordinates(blocks, node)
    there = step_node(blocks, node, dx, dy, dz)
    share = crossing_share(node_value[node], node_value[there], contour.level)
    vertex_position[v, 0] = h * (real(jx) + real(dx) * share)
    vertex_position[v, 1] = h * (real(jy) + real(dy) * share)
    vertex_position[v, 2] = h * (real(jz) + real(dz) * share)
