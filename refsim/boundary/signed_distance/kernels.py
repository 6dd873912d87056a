"""What one triangle, one node, one row of blocks and one point do for the signed distance."""

import math

from refsim.backends.compile import formula, kernel
from refsim.boundary.signed_distance.formulas import (
    CULL_SLACK,
    MOST_STEPS,
    WIDTH,
    block_key,
    block_range,
    box_distance,
    step_in_block,
    triangle_offset,
    trilinear,
)
from refsim.sparse_grid.formulas import BLOCK, cell_coordinate, find_node, node_coordinates
from refsim.winding_number.formulas import winding_at


@kernel
def count_blocks(t, triangles, band_grid, block_count):
    """Patent P1: number of blocks within the band of triangle t; dimensionless."""
    block_count[t] = blocks_of_triangle(t, triangles, band_grid, -1, block_count, block_count)


@kernel(rows_of="block_first")
def list_blocks(t, triangles, band_grid, block_first, pair_key, pair_triangle):
    """Patent P1: the pairs (key of a block, triangle t) of the blocks within the band of triangle t; dimensionless."""
    if t < block_first.shape[0] - 1:
        blocks_of_triangle(t, triangles, band_grid, block_first[t], pair_key, pair_triangle)


@formula
def blocks_of_triangle(t, triangles, grid, first, pair_key, pair_triangle):
    """Number of blocks within the band of triangle t, out of those that meet its bounding box, grown by the band.

    A block counts if its centre is no farther from the triangle than the band plus half the block's diagonal. Pairs
    (block, triangle) are written from index `first` on; none if `first` is negative.
    """
    h = grid.spacing
    real = type(h)
    corner, normal = triangles.corner, triangles.normal
    x0 = min(corner[t, 0], corner[t, 3], corner[t, 6])
    y0 = min(corner[t, 1], corner[t, 4], corner[t, 7])
    z0 = min(corner[t, 2], corner[t, 5], corner[t, 8])
    x1 = max(corner[t, 0], corner[t, 3], corner[t, 6])
    y1 = max(corner[t, 1], corner[t, 4], corner[t, 7])
    z1 = max(corner[t, 2], corner[t, 5], corner[t, 8])
    bx0, bx1 = block_range(x0 - grid.band, x1 + grid.band, grid.inverse_spacing)
    by0, by1 = block_range(y0 - grid.band, y1 + grid.band, grid.inverse_spacing)
    bz0, bz1 = block_range(z0 - grid.band, z1 + grid.band, grid.inverse_spacing)
    reach = (grid.band + grid.half_diagonal) * real(CULL_SLACK)
    center = real(1.5)
    count = 0
    for bz in range(bz0, bz1 + 1):
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                px = h * (real(WIDTH * bx) + center)
                py = h * (real(WIDTH * by) + center)
                pz = h * (real(WIDTH * bz) + center)
                height = (
                    (px - corner[t, 0]) * normal[t, 0]
                    + (py - corner[t, 1]) * normal[t, 1]
                    + (pz - corner[t, 2]) * normal[t, 2]
                )
                if abs(height) <= reach:
                    ox, oy, oz, _ = triangle_offset(px, py, pz, t, corner, normal)
                    if ox * ox + oy * oy + oz * oz <= reach * reach:
                        if first >= 0:
                            pair_key[first + count] = block_key(bx, by, bz)
                            pair_triangle[first + count] = t
                        count += 1
    return count


@kernel
def nearest(n, triangles, band_grid, band_blocks, triangle_lists, unsigned_distance, closest):
    """Patent P1: distance [m] of node n, at most the band, and its closest triangle, -1 beyond the band.

    Of the triangles that share the closest edge or corner the lowest is kept, independent of the rounding of distances.
    Triangles whose bounding box is farther than the nearest so far are skipped.
    """
    h = band_grid.spacing
    real = type(h)
    jx, jy, jz = node_coordinates(band_blocks, n)
    px, py, pz = h * real(jx), h * real(jy), h * real(jz)
    corner = triangles.corner
    best = band_grid.band * band_grid.band
    found = -1
    for k in range(triangle_lists.first[n >> 6], triangle_lists.first[(n >> 6) + 1]):
        t = triangle_lists.triangle[k]
        ax, ay, az = corner[t, 0], corner[t, 1], corner[t, 2]
        bx, by, bz = corner[t, 3], corner[t, 4], corner[t, 5]
        cx, cy, cz = corner[t, 6], corner[t, 7], corner[t, 8]
        x = box_distance(px, min(ax, bx, cx), max(ax, bx, cx))
        y = box_distance(py, min(ay, by, cy), max(ay, by, cy))
        z = box_distance(pz, min(az, bz, cz), max(az, bz, cz))
        if x * x + y * y + z * z <= best:
            ox, oy, oz, f = triangle_offset(px, py, pz, t, corner, triangles.normal)
            squared = ox * ox + oy * oy + oz * oz
            if squared < best or (found < 0 and squared <= best):
                best = squared
                found = triangles.owner[t, f]
    unsigned_distance[n] = band_grid.band if found < 0 else math.sqrt(best)
    closest[n] = found


@kernel
def signs(n, triangles, band_grid, band_blocks, closest, unsigned_distance, winding_clusters, unclear, distance):
    """Patent P1 with E26: phi [m] of node n, negative where (x_n - c).m < 0; beyond the band the value stays unsigned.

    m is the angle-weighted pseudonormal of the face, edge or corner on which the closest point c lies. Where that is
    unclear phi < 0 if the winding number exceeds 1/2.
    """
    h = band_grid.spacing
    real = type(h)
    value = unsigned_distance[n]
    t = closest[n]
    if t >= 0:
        jx, jy, jz = node_coordinates(band_blocks, n)
        px, py, pz = h * real(jx), h * real(jy), h * real(jz)
        normal = triangles.normal
        ox, oy, oz, f = triangle_offset(px, py, pz, t, triangles.corner, normal)
        inside = ox * normal[t, 3 * f] + oy * normal[t, 3 * f + 1] + oz * normal[t, 3 * f + 2] < 0
        if winding_clusters is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if unclear[t, f]:
                inside = winding_at(px, py, pz, winding_clusters) > real(0.5)
        if inside:
            value = -value
    distance[n] = value


@kernel(rows_of="row_first")
def fill(row, band_grid, row_first, closest, distance, inside_after):
    """Patent E26: signs [m] beyond the band along one row of blocks: the side of the node before it along x.

    Two neighbouring nodes lie on different sides only if both are nearer to the surface than their spacing.
    """
    if row < row_first.shape[0] - 1:
        for line in range(16):
            inside = False
            for b in range(row_first[row], row_first[row + 1]):
                for x in range(WIDTH):
                    n = BLOCK * b + WIDTH * line + x
                    if closest[n] >= 0:
                        inside = distance[n] < 0
                    elif inside:
                        distance[n] = -band_grid.band
                    else:
                        distance[n] = band_grid.band
                if line == 0:
                    inside_after[b] = inside


@kernel
def interpolate(i, query, distance_field, query_distance, query_gradient):
    """Patent P1: phi [m] at a point, and its slope (dimensionless), trilinear."""
    value, gx, gy, gz = trilinear(query[i, 0], query[i, 1], query[i, 2], distance_field)
    query_distance[i] = value
    query_gradient[i, 0], query_gradient[i, 1], query_gradient[i, 2] = gx, gy, gz


@kernel
def project(i, query, triangles, distance_field, projected, projected_normal):
    """Nearest point [m] of the mesh to a point, and the pseudonormal there; the point itself and 0 if none is near.

    The search begins with the triangles that are closest to the corners of the point's cell, and goes from the nearest
    of them across edges to neighbours as long as these are nearer.
    """
    x, y, z = query[i, 0], query[i, 1], query[i, 2]
    real = type(distance_field.spacing)
    px, py = float(x) - distance_field.origin_x, float(y) - distance_field.origin_y
    pz = float(z) - distance_field.origin_z
    jx = cell_coordinate(px, distance_field.inverse_spacing, 0.0)
    jy = cell_coordinate(py, distance_field.inverse_spacing, 0.0)
    jz = cell_coordinate(pz, distance_field.inverse_spacing, 0.0)
    qx, qy, qz = real(px), real(py), real(pz)
    best = real(math.inf)
    ox, oy, oz = real(0), real(0), real(0)
    closest, feature = -1, 0
    node = find_node(distance_field, jx, jy, jz)
    for c in range(8):
        there = (
            step_in_block(distance_field, node, c & 1, (c >> 1) & 1, c >> 2)
            if node >= 0
            else find_node(distance_field, jx + (c & 1), jy + ((c >> 1) & 1), jz + (c >> 2))
        )
        t = distance_field.closest[there] if there >= 0 else -1
        if t >= 0 and t != closest:
            dx, dy, dz, f = triangle_offset(qx, qy, qz, t, triangles.corner, triangles.normal)
            squared = dx * dx + dy * dy + dz * dz
            if squared < best or (squared == best and t < closest):
                best = squared
                ox, oy, oz = dx, dy, dz
                closest, feature = t, f
    for _ in range(MOST_STEPS if closest >= 0 else 0):
        start = closest
        for k in range(3):
            t = triangles.across[start, k]
            dx, dy, dz, f = triangle_offset(qx, qy, qz, t, triangles.corner, triangles.normal)
            squared = dx * dx + dy * dy + dz * dz
            if squared < best:
                best = squared
                ox, oy, oz = dx, dy, dz
                closest, feature = t, f
        if closest == start:
            break
    projected[i, 0], projected[i, 1], projected[i, 2] = x - ox, y - oy, z - oz
    for c in range(3):
        projected_normal[i, c] = triangles.normal[closest, 3 * feature + c] if closest >= 0 else x - x  # NaN stays NaN
