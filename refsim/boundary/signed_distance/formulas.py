"""Scalar formulas of the signed distance from a triangle mesh: closest points, cells of the band, trilinear values."""

import math

from refsim.backends.compile import formula
from refsim.sparse_grid.formulas import BLOCK, cell_coordinate, find_node, find_node_near

FACE = 0  # features of a triangle a b c: its face, then edges ab, bc, ca (1 to 3), then corners a, b, c (4 to 6)
MOST_STEPS = 32  # from triangle to triangle towards the nearest one
WIDTH = 4  # nodes along a block
CULL_SLACK = 1.0001  # rounding must not exclude a block that is within the band


@formula
def edge_offset(px, py, pz, ax, ay, az, bx, by, bz):
    """Patent P1, closest point c of the edge ab: p - c = p - a - t (b - a) [m].

    t = (p - a).(b - a)/|b - a|^2, clamped to [0, 1].
    Returns (x, y, z of p - c, end at which c lies: 0 none, 1 a, 2 b).
    """
    ex, ey, ez = bx - ax, by - ay, bz - az
    dx, dy, dz = px - ax, py - ay, pz - az
    along = dx * ex + dy * ey + dz * ez
    length = ex * ex + ey * ey + ez * ez
    if along <= 0:
        return dx, dy, dz, 1
    if along >= length:
        return px - bx, py - by, pz - bz, 2
    t = along / length
    return dx - t * ex, dy - t * ey, dz - t * ez, 0


@formula
def triangle_offset(px, py, pz, t, corner, normal):
    """Patent P1, closest point c of triangle t to p: (x, y, z of p - c [m], feature on which c lies).

    If p projects into the face, p - c = ((p - a).n) n; otherwise c lies on the nearest of the edges beyond which p is.
    """
    real = type(px)
    nx, ny, nz = normal[t, 0], normal[t, 1], normal[t, 2]
    best = real(math.inf)
    ox, oy, oz = real(0), real(0), real(0)
    feature = FACE
    for k in range(3):
        a = 3 * k
        b = 3 * ((k + 1) % 3)
        ax, ay, az = corner[t, a], corner[t, a + 1], corner[t, a + 2]
        bx, by, bz = corner[t, b], corner[t, b + 1], corner[t, b + 2]
        ex, ey, ez = bx - ax, by - ay, bz - az
        dx, dy, dz = px - ax, py - ay, pz - az
        mx, my, mz = ey * nz - ez * ny, ez * nx - ex * nz, ex * ny - ey * nx  # outward, in the triangle's plane
        if dx * mx + dy * my + dz * mz > 0:
            qx, qy, qz, end = edge_offset(px, py, pz, ax, ay, az, bx, by, bz)
            squared = qx * qx + qy * qy + qz * qz
            if squared < best:
                best = squared
                ox, oy, oz = qx, qy, qz
                feature = 1 + k
                if end == 1:
                    feature = 4 + k
                elif end == 2:
                    feature = 4 + (k + 1) % 3
    if feature == FACE:
        height = (px - corner[t, 0]) * nx + (py - corner[t, 1]) * ny + (pz - corner[t, 2]) * nz
        ox, oy, oz = height * nx, height * ny, height * nz
    return ox, oy, oz, feature


@formula
def box_distance(p, low, high):
    """Distance [m] of a coordinate from an interval: d = max(low - p, 0, p - high)."""
    return max(low - p, p - high, type(p)(0))


@formula
def block_range(low, high, inverse_spacing):
    """Blocks along one axis that hold nodes of [low, high] [m]: b = floor(j/4), j = floor(low/h) to ceil(high/h)."""
    first = cell_coordinate(low, inverse_spacing, 0.0)
    last = cell_coordinate(high, inverse_spacing, 0.0) + 1
    return first >> 2, last >> 2


@formula
def band_value(field, jx, jy, jz):
    """phi_j [m] at the node with integer coordinates j; without a block phi = -band inside and +band outside.

    A missing block holds no node of the band, so it lies entirely on the side that follows the last block before it
    along x in the same row of blocks (patent E26).
    """
    node = find_node(field, jx, jy, jz)
    if node >= 0:
        return field.distance[node]
    if beyond_inside(field, jx, jy, jz):
        return -field.band
    return field.band


@formula
def beyond_inside(field, jx, jy, jz):
    """Whether a node j without a block lies inside: flag = that of the last block before it in its row of blocks."""
    key = block_key(jx >> 2, jy >> 2, jz >> 2)
    low = 0
    high = field.keys.shape[0]
    while low < high:
        middle = (low + high) >> 1
        if field.keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    if low == 0:
        return False
    return (field.keys[low - 1] >> 21) == (key >> 21) and field.inside_after[low - 1] != 0


@formula
def block_key(bx, by, bz):
    """Sortable key of a block, x lowest: key = (bz + 2^20) 2^42 + (by + 2^20) 2^21 + bx + 2^20, dimensionless."""
    return ((bz + 1048576) << 42) | ((by + 1048576) << 21) | (bx + 1048576)


@formula
def step_in_block(field, node, dx, dy, dz):
    """Node at offset (dx, dy, dz) in {0, 1}^3, -1 if no block holds it: n = 64 b + l, dimensionless."""
    local = node & 63
    x = (local & 3) + dx
    y = ((local >> 2) & 3) + dy
    z = (local >> 4) + dz
    b = field.neighbour[node >> 6, 13 + (x >> 2) + 3 * (y >> 2) + 9 * (z >> 2)]
    if b < 0:
        return -1
    return b * BLOCK + (((z & 3) << 4) | ((y & 3) << 2) | (x & 3))


@formula
def trilinear(x, y, z, field):
    """Patent P1: (phi = sum_c w_c phi_c [m], d phi/dx, d phi/dy, d phi/dz) between nodes; see `trilinear_near`."""
    phi, gx, gy, gz, _ = trilinear_near(x, y, z, field, -1)
    return phi, gx, gy, gz


@formula(inlined=True)
def trilinear_near(x, y, z, field, block):
    """Patent P1, value and slope of phi between nodes: (phi [m], d phi/dx, d phi/dy, d phi/dz, block of x).

    phi = sum_c w_c phi_c over the 8 corners of the cell, w_c the product of u or 1 - u along each axis. Beyond the
    band phi = -band inside and +band outside, and the slope is 0. x [m] is in the scene's frame. The search for the
    cell begins with block number `block` (-1 for none); the block returned is -1 if no block holds x.
    """
    h = field.spacing
    real = type(h)
    px, py, pz = float(x) - field.origin_x, float(y) - field.origin_y, float(z) - field.origin_z
    jx = cell_coordinate(px, field.inverse_spacing, 0.0)
    jy = cell_coordinate(py, field.inverse_spacing, 0.0)
    jz = cell_coordinate(pz, field.inverse_spacing, 0.0)
    u = real(px * field.inverse_spacing - jx)
    v = real(py * field.inverse_spacing - jy)
    w = real(pz * field.inverse_spacing - jz)
    node = find_node_near(field, jx, jy, jz, block)
    least = node
    if node >= 0:
        n100, n010 = step_in_block(field, node, 1, 0, 0), step_in_block(field, node, 0, 1, 0)
        n110, n001 = step_in_block(field, node, 1, 1, 0), step_in_block(field, node, 0, 0, 1)
        n101, n011 = step_in_block(field, node, 1, 0, 1), step_in_block(field, node, 0, 1, 1)
        n111 = step_in_block(field, node, 1, 1, 1)
        least = min(min(min(n100, n010), min(n110, n001)), min(min(n101, n011), n111))
    if least >= 0:
        f000, f100, f010, f110 = field.distance[node], field.distance[n100], field.distance[n010], field.distance[n110]
        f001, f101, f011, f111 = field.distance[n001], field.distance[n101], field.distance[n011], field.distance[n111]
    else:
        f000 = band_value(field, jx, jy, jz)
        f100 = band_value(field, jx + 1, jy, jz)
        f010 = band_value(field, jx, jy + 1, jz)
        f110 = band_value(field, jx + 1, jy + 1, jz)
        f001 = band_value(field, jx, jy, jz + 1)
        f101 = band_value(field, jx + 1, jy, jz + 1)
        f011 = band_value(field, jx, jy + 1, jz + 1)
        f111 = band_value(field, jx + 1, jy + 1, jz + 1)
    one = real(1)
    f00, f10 = f000 + u * (f100 - f000), f010 + u * (f110 - f010)
    f01, f11 = f001 + u * (f101 - f001), f011 + u * (f111 - f011)
    f0, f1 = f00 + v * (f10 - f00), f01 + v * (f11 - f01)
    gx = (one - w) * ((one - v) * (f100 - f000) + v * (f110 - f010)) + w * (
        (one - v) * (f101 - f001) + v * (f111 - f011)
    )
    gy = (one - w) * (f10 - f00) + w * (f11 - f01)
    return f0 + w * (f1 - f0), gx / h, gy / h, (f1 - f0) / h, node >> 6
