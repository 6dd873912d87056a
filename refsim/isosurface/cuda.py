"""CUDA kernels of isosurfaces."""

from refsim.backends.compile import cuda, cuda_kernel
from refsim.isosurface import node


@cuda_kernel
def classify(blocks, node_state, crossings, cell_case):
    """Cut edges and corner states; integers."""
    i = cuda.grid(1)
    if i < cell_case.shape[0]:
        bits, case = node.classify(i, blocks, node_state)
        crossings[i] = bits
        cell_case[i] = case


@cuda_kernel(rows_of="cell_case")
def facets(blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets):
    """Vertices by their edges, facets by their vertices; integers."""
    i = cuda.grid(1)
    if i < cell_case.shape[0]:
        node.write_facets(i, blocks, crossings, cell_case, edge_first, facet_first, table, vertex_edge, facets)


@cuda_kernel
def edge_points(blocks, node_value, contour, vertex_edge, vertex_position):
    """Linear crossing of every cut edge."""
    v = cuda.grid(1)
    if v < vertex_position.shape[0]:
        x, y, z = node.edge_point(v, blocks, node_value, contour, vertex_edge)
        vertex_position[v, 0] = x
        vertex_position[v, 1] = y
        vertex_position[v, 2] = z
