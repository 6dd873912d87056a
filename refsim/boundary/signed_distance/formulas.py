"""Scalar formulas of the signed distance from a triangle mesh: closest points, cells of the band, trilinear values."""

import math

from refsim.backends.compile import formula
from refsim.backends.tuples import cross, difference, dot, entrywise, scaled, triple
from refsim.neighbours.formulas import BITS, lower_bound
from refsim.sparse_grid.formulas import block_key, cell_coordinate, find_node, step_node

FACE, CORNER = 0, 4  # features of a triangle a b c: its face, edges ab, bc, ca (1 to 3), corners a, b, c (4 to 6)
MOST_STEPS = 32  # from triangle to triangle towards the nearest one
WIDTH = 4  # nodes along a block
CULL_SLACK = 1.0001  # rounding must not exclude a block that is within the band


@formula
def edge_offset(p, a, b):
    """Patent P1, closest point c of the edge ab: p - c = p - a - t (b - a) [m].

    t = (p - a).(b - a)/|b - a|^2, clamped to [0, 1].
    Returns (p - c, end at which c lies: 0 none, 1 a, 2 b).
    """
    edge, away = difference(b, a), difference(p, a)
    along, length = dot(away, edge), dot(edge, edge)
    if along <= 0:
        return away, 1
    if along >= length:
        return difference(p, b), 2
    return difference(away, scaled(edge, along / length)), 0


@formula
def triangle_offset(p, t, corner, normal):
    """Patent P1, closest point c of triangle t to p: (p - c [m], feature on which c lies).

    If p projects into the face, p - c = ((p - a).n) n; otherwise c lies on the nearest of the edges beyond which p is.
    """
    real, n = type(p[0]), triple(normal, t, 0)
    best, offset, feature = real(math.inf), (real(0), real(0), real(0)), FACE
    for k in range(3):
        a, b = triple(corner, t, k), triple(corner, t, (k + 1) % 3)
        outward = cross(difference(b, a), n)  # in the triangle's plane
        if dot(difference(p, a), outward) > 0:
            q, end = edge_offset(p, a, b)
            squared = dot(q, q)
            if squared < best:
                best, offset = squared, q
                feature = 1 + k if end == 0 else CORNER + (k + end - 1) % 3
    if feature == FACE:
        offset = scaled(n, dot(difference(p, triple(corner, t, 0)), n))
    return offset, feature


@entrywise
def box_distance(p, low, high):
    """Distance [m] of a coordinate from an interval: d = max(low - p, 0, p - high)."""
    return max(low - p, p - high, type(p)(0))


@entrywise
def block_range(low, high, inverse_spacing):
    """Blocks along one axis that hold nodes of [low, high] [m]: b = floor(j/4), j = floor(low/h) to ceil(high/h)."""
    first = cell_coordinate(low, inverse_spacing, 0.0)
    last = cell_coordinate(high, inverse_spacing, 0.0) + 1
    return first >> 2, last >> 2


@formula
def place_in_field(place, field):
    """(x [m] relative to the mesh, coordinates j of its cell) of a place in the scene; x is float64, j = floor(x/h)."""
    x, y, z = float(place[0]) - field.origin_x, float(place[1]) - field.origin_y, float(place[2]) - field.origin_z
    inverse = field.inverse_spacing
    j = cell_coordinate(x, inverse, 0.0), cell_coordinate(y, inverse, 0.0), cell_coordinate(z, inverse, 0.0)
    return (x, y, z), j


@formula
def band_value(field, jx, jy, jz):
    """phi_j = phi [m] of the node with integer coordinates j, or what `value_beyond` says."""
    node = find_node(field, jx, jy, jz)
    return field.distance[node] if node >= 0 else value_beyond(field, jx, jy, jz)


@formula
def value_beyond(field, jx, jy, jz):
    """phi_j = -band inside and +band outside [m] at a node without a block.

    A missing block holds no node of the band, so it lies entirely on the side that follows the last block before it
    along x in the same row of blocks (patent E26).
    """
    key = block_key(jx, jy, jz, 2)
    before = lower_bound(field.keys, key) - 1
    if before >= 0 and field.keys[before] >> BITS == key >> BITS and field.inside_after[before]:
        return -field.band
    return field.band


@formula
def trilinear(x, field):
    """Patent P1, value and slope of phi between nodes at x: (phi [m], its slope along x, y, z).

    phi = sum_c w_c phi_c over the 8 corners of the cell, w_c the product of u or 1 - u along each axis. Beyond the
    band phi = -band inside and +band outside, and the slope is 0. x [m] is in the scene's frame.
    """
    h = field.spacing
    real = type(h)
    place, (jx, jy, jz) = place_in_field(x, field)
    u = real(place[0] * field.inverse_spacing - jx)
    v = real(place[1] * field.inverse_spacing - jy)
    w = real(place[2] * field.inverse_spacing - jz)
    node = find_node(field, jx, jy, jz)
    least = node
    if node >= 0:
        n100, n010 = step_node(field, node, 1, 0, 0), step_node(field, node, 0, 1, 0)
        n110, n001 = step_node(field, node, 1, 1, 0), step_node(field, node, 0, 0, 1)
        n101, n011 = step_node(field, node, 1, 0, 1), step_node(field, node, 0, 1, 1)
        n111 = step_node(field, node, 1, 1, 1)
        least = min(min(min(n100, n010), min(n110, n001)), min(min(n101, n011), n111))
    if least >= 0:
        f000, f100, f010, f110 = field.distance[node], field.distance[n100], field.distance[n010], field.distance[n110]
        f001, f101, f011, f111 = field.distance[n001], field.distance[n101], field.distance[n011], field.distance[n111]
    else:
        f000, f100 = band_value(field, jx, jy, jz), band_value(field, jx + 1, jy, jz)
        f010, f110 = band_value(field, jx, jy + 1, jz), band_value(field, jx + 1, jy + 1, jz)
        f001, f101 = band_value(field, jx, jy, jz + 1), band_value(field, jx + 1, jy, jz + 1)
        f011, f111 = band_value(field, jx, jy + 1, jz + 1), band_value(field, jx + 1, jy + 1, jz + 1)
    one = real(1)
    f00, f10 = f000 + u * (f100 - f000), f010 + u * (f110 - f010)
    f01, f11 = f001 + u * (f101 - f001), f011 + u * (f111 - f011)
    f0, f1 = f00 + v * (f10 - f00), f01 + v * (f11 - f01)
    gx = (one - w) * ((one - v) * (f100 - f000) + v * (f110 - f010)) + w * (
        (one - v) * (f101 - f001) + v * (f111 - f011)
    )
    gy = (one - w) * (f10 - f00) + w * (f11 - f01)
    return f0 + w * (f1 - f0), (gx / h, gy / h, (f1 - f0) / h)
