"""What one triangle, one node, one row of blocks and one point do for the signed distance; both kernels share it."""

import math

from refsim.backends.compile import formula
from refsim.boundary.signed_distance.formulas import (
    CULL_SLACK,
    MOST_WALKS,
    WIDTH,
    block_key,
    block_range,
    box_distance,
    edge_pierces,
    step_in_block,
    triangle_offset,
)
from refsim.sparse_grid.formulas import BLOCK, cell_coordinate, find_node, node_coordinates


@formula
def blocks_of_triangle(t, triangles, grid, first, pair_key, pair_triangle):
    """Number of blocks within the band of triangle t, out of those that its bounding box, grown by the band, meets.

    A block is kept where its middle is no further from the triangle than the band and half its diagonal. The pairs
    are written from place `first` on, none where it is negative.
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
    middle = real(1.5)
    count = 0
    for bz in range(bz0, bz1 + 1):
        for by in range(by0, by1 + 1):
            for bx in range(bx0, bx1 + 1):
                px = h * (real(WIDTH * bx) + middle)
                py = h * (real(WIDTH * by) + middle)
                pz = h * (real(WIDTH * bz) + middle)
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


@formula
def nearest_triangle(n, triangles, grid, blocks, lists):
    """(unsigned distance [m] of node n, at most the band; its closest triangle, -1 beyond the band).

    Of the triangles that share the closest edge or corner it is the lowest, whatever rounding says of their distances.
    Triangles whose bounding box is further than the nearest so far are left out.
    """
    h = grid.spacing
    real = type(h)
    jx, jy, jz = node_coordinates(blocks, n)
    px, py, pz = h * real(jx), h * real(jy), h * real(jz)
    corner = triangles.corner
    best = grid.band * grid.band
    closest = -1
    for k in range(lists.first[n >> 6], lists.first[(n >> 6) + 1]):
        t = lists.triangle[k]
        ax, ay, az = corner[t, 0], corner[t, 1], corner[t, 2]
        bx, by, bz = corner[t, 3], corner[t, 4], corner[t, 5]
        cx, cy, cz = corner[t, 6], corner[t, 7], corner[t, 8]
        x = box_distance(px, min(ax, bx, cx), max(ax, bx, cx))
        y = box_distance(py, min(ay, by, cy), max(ay, by, cy))
        z = box_distance(pz, min(az, bz, cz), max(az, bz, cz))
        if x * x + y * y + z * z <= best:
            ox, oy, oz, f = triangle_offset(px, py, pz, t, corner, triangles.normal)
            squared = ox * ox + oy * oy + oz * oz
            if squared < best or (closest < 0 and squared <= best):
                best = squared
                closest = triangles.owner[t, f]
    if closest < 0:
        return grid.band, -1
    return math.sqrt(best), closest


@formula
def is_inside(n, triangles, grid, blocks, t):
    """Whether node n is inside: (p - c).n < 0 for the angle-weighted pseudonormal n of the closest feature (E26)."""
    h = grid.spacing
    real = type(h)
    jx, jy, jz = node_coordinates(blocks, n)
    ox, oy, oz, f = triangle_offset(h * real(jx), h * real(jy), h * real(jz), t, triangles.corner, triangles.normal)
    normal = triangles.normal
    return ox * normal[t, 3 * f] + oy * normal[t, 3 * f + 1] + oz * normal[t, 3 * f + 2] < 0


@formula
def fill_row(row, grid, row_first, closest, distance, inside_after):
    """Signs beyond the band along one row of blocks: a node beyond it is on the side of the node before it along x.

    Two nodes side by side stand on two sides only if both are nearer to the surface than their spacing (E26).
    """
    for line in range(16):
        inside = False
        for b in range(row_first[row], row_first[row + 1]):
            for x in range(WIDTH):
                n = BLOCK * b + WIDTH * line + x
                if closest[n] >= 0:
                    inside = distance[n] < 0
                elif inside:
                    distance[n] = -grid.band
                else:
                    distance[n] = grid.band
            if line == 0:
                inside_after[b] = inside


@formula
def crossings_of_block(b, triangles, lists):
    """(pairs of triangles of block b that cross, the lower and the higher number of the first such pair or -1, -1).

    Triangles with a common corner are no pair; they could only cross along a fold that has no thickness.
    """
    count = 0
    one, other = -1, -1
    corner, normal = triangles.corner, triangles.normal
    for k in range(lists.first[b], lists.first[b + 1]):
        t = lists.triangle[k]
        for m in range(k + 1, lists.first[b + 1]):
            s = lists.triangle[m]
            if boxes_meet(t, s, corner) and not share_corner(t, s, triangles.vertex):
                crossing = False
                for e in range(3):
                    crossing = (
                        crossing or edge_pierces(t, e, s, corner, normal) or edge_pierces(s, e, t, corner, normal)
                    )
                if crossing:
                    if count == 0:
                        one, other = t, s
                    count += 1
    return count, one, other


@formula
def boxes_meet(t, s, corner):
    """Whether the bounding boxes of two triangles overlap."""
    for c in range(3):
        low = max(
            min(corner[t, c], corner[t, c + 3], corner[t, c + 6]), min(corner[s, c], corner[s, c + 3], corner[s, c + 6])
        )
        high = min(
            max(corner[t, c], corner[t, c + 3], corner[t, c + 6]), max(corner[s, c], corner[s, c + 3], corner[s, c + 6])
        )
        if low > high:
            return False
    return True


@formula
def share_corner(t, s, vertex):
    """Whether two triangles have a vertex in common."""
    for a in range(3):
        for b in range(3):
            if vertex[t, a] == vertex[s, b]:
                return True
    return False


@formula
def nearest_of_cell(x, y, z, triangles, field):
    """Nearest point [m] to (x, y, z), from the triangles that are closest to the corners of its cell.

    From the nearest of those it goes over edges to the nearest neighbour as long as that is nearer.
    Returns (x, y, z of the point, triangle, feature), the point itself and -1 where the cell has no triangle.
    """
    real = type(field.spacing)
    px, py, pz = float(x) - field.origin_x, float(y) - field.origin_y, float(z) - field.origin_z
    jx = cell_coordinate(px, field.inverse_spacing, 0.0)
    jy = cell_coordinate(py, field.inverse_spacing, 0.0)
    jz = cell_coordinate(pz, field.inverse_spacing, 0.0)
    qx, qy, qz = real(px), real(py), real(pz)
    best = real(math.inf)
    ox, oy, oz = real(0), real(0), real(0)
    closest, feature = -1, 0
    node = find_node(field, jx, jy, jz)
    for c in range(8):
        there = (
            step_in_block(field, node, c & 1, (c >> 1) & 1, c >> 2)
            if node >= 0
            else find_node(field, jx + (c & 1), jy + ((c >> 1) & 1), jz + (c >> 2))
        )
        t = field.closest[there] if there >= 0 else -1
        if t >= 0 and t != closest:
            dx, dy, dz, f = triangle_offset(qx, qy, qz, t, triangles.corner, triangles.normal)
            squared = dx * dx + dy * dy + dz * dz
            if squared < best or (squared == best and t < closest):
                best = squared
                ox, oy, oz = dx, dy, dz
                closest, feature = t, f
    for _ in range(MOST_WALKS if closest >= 0 else 0):
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
    return x - ox, y - oy, z - oz, closest, feature
