"""What one triangle, one node, one row of blocks and one point do for the signed distance."""

import math

from refsim.backends.compile import formula, kernel
from refsim.backends.tuples import added, difference, dot, greatest_of, least_of, put, scaled, three, triple
from refsim.boundary.signed_distance.formulas import (
    CORNER,
    CULL_SLACK,
    MOST_STEPS,
    WIDTH,
    block_range,
    box_distance,
    place_in_field,
    triangle_offset,
    trilinear,
)
from refsim.neighbours.formulas import OFFSET, cell_key
from refsim.sparse_grid.formulas import BLOCK, find_node, node_coordinates, step_node
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
    a, b, c = triple(corner, t, 0), triple(corner, t, 1), triple(corner, t, 2)
    low, high = difference(least_of(a, b, c), grid.band), added(greatest_of(a, b, c), grid.band)
    (bx0, bx1), (by0, by1), (bz0, bz1) = block_range(low, high, grid.inverse_spacing)
    reach = (grid.band + grid.half_diagonal) * real(CULL_SLACK)
    center = real(1.5)
    count = 0
    for bz in range(bz0, bz1 + 1):
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                p = added((real(WIDTH * bx), real(WIDTH * by), real(WIDTH * bz)), center)
                p = scaled(p, h)
                if abs(dot(difference(p, a), triple(normal, t, 0))) <= reach:
                    offset, _ = triangle_offset(p, t, corner, normal)
                    if dot(offset, offset) <= reach * reach:
                        if first >= 0:
                            pair_key[first + count] = cell_key(bx + OFFSET, by + OFFSET, bz + OFFSET)
                            pair_triangle[first + count] = t
                        count += 1
    return count


@formula
def node_place(n, band_grid, band_blocks):
    """Place h j [m] of node n relative to the mesh's origin."""
    h, (jx, jy, jz) = band_grid.spacing, node_coordinates(band_blocks, n)
    real = type(h)
    return scaled((real(jx), real(jy), real(jz)), h)


@kernel
def nearest(n, triangles, band_grid, band_blocks, triangle_lists, unsigned_distance, closest):
    """Patent P1: distance [m] of node n, at most the band, and its closest triangle, -1 beyond the band.

    Of the triangles that share the closest edge or corner the lowest is kept, independent of the rounding of distances.
    Triangles whose bounding box is farther than the nearest so far are skipped.
    """
    corner, p = triangles.corner, node_place(n, band_grid, band_blocks)
    best = band_grid.band * band_grid.band
    found = -1
    for k in range(triangle_lists.first[n >> 6], triangle_lists.first[(n >> 6) + 1]):
        t = triangle_lists.triangle[k]
        a, b, c = triple(corner, t, 0), triple(corner, t, 1), triple(corner, t, 2)
        away = box_distance(p, least_of(a, b, c), greatest_of(a, b, c))
        if dot(away, away) <= best:
            offset, f = triangle_offset(p, t, corner, triangles.normal)
            squared = dot(offset, offset)
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
    value = unsigned_distance[n]
    t = closest[n]
    if t >= 0:
        p = node_place(n, band_grid, band_blocks)
        offset, f = triangle_offset(p, t, triangles.corner, triangles.normal)
        inside = dot(offset, triple(triangles.normal, t, f)) < 0
        if winding_clusters is not None:  # noqa: SIM102  (a test of its own is what Numba prunes)
            if unclear[t, f]:
                inside = winding_at(p, winding_clusters) > type(value)(0.5)
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
    query_distance[i], slope = trilinear(three(query, i), distance_field)
    put(query_gradient, i, slope)


@formula
def nearer(p, t, triangles, best, offset, closest, feature):
    """(|p - c|^2 [m^2], p - c [m], triangle, feature) of triangle t or of what is nearer so far; ties to the lower."""
    away, f = triangle_offset(p, t, triangles.corner, triangles.normal)
    squared = dot(away, away)
    if squared < best or (squared == best and t < closest):
        return squared, away, t, f
    return best, offset, closest, feature


@kernel
def project(i, query, triangles, distance_field, projected, projected_normal):
    """Nearest point [m] of the mesh to a point, and the pseudonormal there; the point itself and 0 if none is near.

    The search begins with the triangles that are closest to the corners of the point's cell, and goes from the nearest
    of them across edges, and across the corner that it meets, to neighbours as long as these are nearer.
    """
    x, real = three(query, i), type(distance_field.spacing)
    place, (jx, jy, jz) = place_in_field(x, distance_field)
    p = real(place[0]), real(place[1]), real(place[2])
    best, offset = real(math.inf), (real(0), real(0), real(0))
    closest, feature = -1, 0
    node = find_node(distance_field, jx, jy, jz)
    for c in range(8):
        there = (
            step_node(distance_field, node, c & 1, (c >> 1) & 1, c >> 2)
            if node >= 0
            else find_node(distance_field, jx + (c & 1), jy + ((c >> 1) & 1), jz + (c >> 2))
        )
        t = distance_field.closest[there] if there >= 0 else -1
        if t >= 0 and t != closest:
            best, offset, closest, feature = nearer(p, t, triangles, best, offset, closest, feature)
    for _ in range(MOST_STEPS if closest >= 0 else 0):
        start, corner = closest, 3 * closest + feature - CORNER
        for k in range(3):
            t = triangles.across[start, k]
            best, offset, closest, feature = nearer(p, t, triangles, best, offset, closest, feature)
        other = triangles.around[start, corner - 3 * start] if corner >= 3 * start else corner
        for _ in range(triangles.around.shape[0]):
            if other == corner:
                break
            t = other // 3
            best, offset, closest, feature = nearer(p, t, triangles, best, offset, closest, feature)
            other = triangles.around[t, other - 3 * t]
        if closest == start:
            break
    put(projected, i, difference(x, offset))
    for c in range(3):
        projected_normal[i, c] = (
            triangles.normal[closest, 3 * feature + c] if closest >= 0 else x[c] - x[c]
        )  # NaN stays
