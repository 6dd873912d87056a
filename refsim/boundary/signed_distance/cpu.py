"""CPU kernels of the signed distance."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.signed_distance import node
from refsim.boundary.signed_distance.formulas import trilinear


@cpu_kernel
def count_blocks(triangles, band_grid, block_count):
    """Blocks within the band of each triangle; integers."""
    for t in prange(block_count.shape[0]):
        block_count[t] = node.blocks_of_triangle(t, triangles, band_grid, -1, block_count, block_count)


@cpu_kernel
def list_blocks(triangles, band_grid, block_first, pair_key, pair_triangle):
    """The pairs themselves; integers."""
    for t in prange(block_first.shape[0] - 1):
        node.blocks_of_triangle(t, triangles, band_grid, block_first[t], pair_key, pair_triangle)


@cpu_kernel
def nearest(triangles, band_grid, band_blocks, triangle_lists, unsigned_distance, closest):
    """Distance and closest triangle of every node."""
    for n in prange(closest.shape[0]):
        distance, triangle = node.nearest_triangle(n, triangles, band_grid, band_blocks, triangle_lists)
        unsigned_distance[n] = distance
        closest[n] = triangle


@cpu_kernel
def signs(triangles, band_grid, band_blocks, closest, unsigned_distance, distance):
    """Signs of the nodes in the band; beyond it the distance stays as it is."""
    for n in prange(distance.shape[0]):
        value = unsigned_distance[n]
        if closest[n] >= 0 and node.is_inside(n, triangles, band_grid, band_blocks, closest[n]):
            value = -value
        distance[n] = value


@cpu_kernel
def fill(band_grid, row_first, closest, distance, inside_after):
    """Signs beyond the band, a row of blocks at a time."""
    for row in prange(row_first.shape[0] - 1):
        node.fill_row(row, band_grid, row_first, closest, distance, inside_after)


@cpu_kernel
def crossings(triangles, triangle_lists, crossing):
    """Triangles that cross, in each block; integers."""
    for b in prange(crossing.shape[0]):
        count, one, other = node.crossings_of_block(b, triangles, triangle_lists)
        crossing[b, 0], crossing[b, 1], crossing[b, 2] = count, one, other


@cpu_kernel
def interpolate(query, distance_field, query_distance, query_gradient):
    """Value and slope at points."""
    for i in prange(query_gradient.shape[0]):
        value, gx, gy, gz = trilinear(query[i, 0], query[i, 1], query[i, 2], distance_field)
        query_distance[i] = value
        query_gradient[i, 0], query_gradient[i, 1], query_gradient[i, 2] = gx, gy, gz


@cpu_kernel
def project(query, triangles, distance_field, projected, projected_normal):
    """Nearest points on the mesh, and the pseudonormals there."""
    for i in prange(projected_normal.shape[0]):
        x, y, z, t, f = node.nearest_of_cell(query[i, 0], query[i, 1], query[i, 2], triangles, distance_field)
        projected[i, 0], projected[i, 1], projected[i, 2] = x, y, z
        for c in range(3):
            projected_normal[i, c] = triangles.normal[t, 3 * f + c] if t >= 0 else x - x
