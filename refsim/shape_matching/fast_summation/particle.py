"""What one cell and one node do in fast summation; the CPU and the CUDA kernels share these. All sums in float64.

Positions and velocities are taken from the first node of the body, cells from the corner of the box.
"""

import numpy as np

from refsim.compile import formula
from refsim.shape_matching.formulas import turned
from refsim.shape_matching.phases import NOBODY


@formula
def coordinates(cell, boxes):
    """(a, b, e) of a cell in the box."""
    return cell // (boxes.side[1] * boxes.side[2]), cell // boxes.side[2] % boxes.side[1], cell % boxes.side[2]


@formula
def exact(row):
    """Three components in float64; `float` would leave a float32 as it is in compiled code."""
    return np.float64(row[0]), np.float64(row[1]), np.float64(row[2])


@formula
def away(s, values, boxes):
    """A node's position [m] or velocity [m/s] from that of its body's first node, in float64."""
    own, first = exact(values[s]), exact(values[boxes.origin[s]])
    return own[0] - first[0], own[1] - first[1], own[2] - first[2]


@formula
def region_place(s, x, region_center):
    """Center of the region of node s [m], from where x is taken."""
    c = exact(region_center[s])
    return x[0] + c[0], x[1] + c[1], x[2] + c[2]


@formula
def clear(cell, row, count):
    """No terms."""
    for c in range(count):
        row[cell, c] = 0.0


@formula
def match_cell(cell, solid_position, region_share, boxes):
    """m, m x, m g, m x g^T and the number of nodes in one cell."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != NOBODY and region_share[s] > 0:
        m = np.float64(region_share[s])
        a, b, e = coordinates(cell, boxes)
        x = away(s, solid_position, boxes)
        g = (float(a), float(b), float(e))
        row[cell, 0], row[cell, 16] = m, 1.0
        for i in range(3):
            row[cell, 1 + i], row[cell, 4 + i] = m * x[i], m * g[i]
            for j in range(3):
                row[cell, 7 + 3 * i + j] = m * x[i] * g[j]


@formula
def match_sums(s, solid_position, boxes, moments):
    """The sums of the box around node s, taken from the node instead of the body's first one; how many nodes it has.

    moments (16,): m, m x, m g, m x g^T.
    """
    cell = boxes.cell[s]
    row = boxes.second
    a, b, e = coordinates(cell, boxes)
    x = away(s, solid_position, boxes)
    g = (float(a), float(b), float(e))
    m = row[cell, 0]
    moments[0] = m
    for i in range(3):
        moments[1 + i] = row[cell, 1 + i] - m * x[i]
        moments[4 + i] = row[cell, 4 + i] - m * g[i]
        for j in range(3):
            about = row[cell, 7 + 3 * i + j] - row[cell, 1 + i] * g[j]
            moments[7 + 3 * i + j] = about - x[i] * (row[cell, 4 + j] - m * g[j])
    return row[cell, 16]


@formula
def goal_cell(cell, solid_position, region_count, region_anchor, rotation, boxes, spacing):
    """R, and anchor + x - R d g, of the region of the node in one cell; and their number."""
    row = boxes.first
    clear(cell, row, 13)
    s = boxes.node[cell]
    if s != NOBODY and region_count[s] > 0:
        a, b, e = coordinates(cell, boxes)
        x = away(s, solid_position, boxes)
        d = np.float64(spacing)
        i, j, k = exact(rotation[s, 1:])
        q = (np.float64(rotation[s, 0]), i, j, k)
        first, second, third = turned(q, 1.0, 0.0, 0.0), turned(q, 0.0, 1.0, 0.0), turned(q, 0.0, 0.0, 1.0)
        for i in range(3):
            row[cell, 3 * i], row[cell, 3 * i + 1], row[cell, 3 * i + 2] = first[i], second[i], third[i]
            there = d * (first[i] * a + second[i] * b + third[i] * e)
            row[cell, 9 + i] = np.float64(region_anchor[s, i]) + x[i] - there
        row[cell, 12] = 1.0


@formula
def goal_sums(s, solid_position, boxes, spacing, sums):
    """Sum over the box around node s of the ways to where its regions take it [m]; how many regions there are."""
    cell = boxes.cell[s]
    row = boxes.second
    a, b, e = coordinates(cell, boxes)
    x = away(s, solid_position, boxes)
    d = np.float64(spacing)
    for i in range(3):
        turned_by = row[cell, 3 * i] * a + row[cell, 3 * i + 1] * b + row[cell, 3 * i + 2] * e
        sums[i] = row[cell, 9 + i] + d * turned_by - row[cell, 12] * x[i]
    return row[cell, 12]


@formula
def motion_cell(cell, solid_position, solid_velocity, region_share, boxes):
    """m, m x, m v, m x x v, m x x^T (xx, yy, zz, xy, xz, yz) of one cell, and the number of nodes in it."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != NOBODY and region_share[s] > 0:
        m = np.float64(region_share[s])
        x, v = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
        row[cell, 0], row[cell, 16] = m, 1.0
        for i in range(3):
            row[cell, 1 + i], row[cell, 4 + i] = m * x[i], m * v[i]
            row[cell, 10 + i] = m * x[i] * x[i]
        row[cell, 7] = m * (x[1] * v[2] - x[2] * v[1])
        row[cell, 8] = m * (x[2] * v[0] - x[0] * v[2])
        row[cell, 9] = m * (x[0] * v[1] - x[1] * v[0])
        row[cell, 13], row[cell, 14], row[cell, 15] = m * x[0] * x[1], m * x[0] * x[2], m * x[1] * x[2]


@formula
def motion_sums(s, solid_position, solid_velocity, region_center, boxes, sums):
    """The sums of the box around node s about its region's center, velocities from the node's; how many nodes it has.

    sums (13,): m v, m r x v, m r r^T (xx, yy, zz, xy, xz, yz), m.
    """
    cell = boxes.cell[s]
    row = boxes.second
    x, u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    c = region_place(s, x, region_center)
    m = row[cell, 0]
    arm = (row[cell, 1] - m * c[0], row[cell, 2] - m * c[1], row[cell, 3] - m * c[2])  # sum m r
    p = (row[cell, 4], row[cell, 5], row[cell, 6])  # sum m v, from the body's first node
    sums[0], sums[1], sums[2] = p[0] - m * u[0], p[1] - m * u[1], p[2] - m * u[2]
    sums[3] = row[cell, 7] - (c[1] * p[2] - c[2] * p[1]) - (arm[1] * u[2] - arm[2] * u[1])
    sums[4] = row[cell, 8] - (c[2] * p[0] - c[0] * p[2]) - (arm[2] * u[0] - arm[0] * u[2])
    sums[5] = row[cell, 9] - (c[0] * p[1] - c[1] * p[0]) - (arm[0] * u[1] - arm[1] * u[0])
    for i in range(3):
        sums[6 + i] = row[cell, 10 + i] - c[i] * (row[cell, 1 + i] + arm[i])
    sums[9] = row[cell, 13] - c[0] * row[cell, 2] - arm[0] * c[1]
    sums[10] = row[cell, 14] - c[0] * row[cell, 3] - arm[0] * c[2]
    sums[11] = row[cell, 15] - c[1] * row[cell, 3] - arm[1] * c[2]
    sums[12] = m
    return row[cell, 16]


@formula
def damp_cell(cell, solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes):
    """omega, and v - omega x (x + center), of the region of the node in one cell; and their number."""
    row = boxes.first
    clear(cell, row, 7)
    s = boxes.node[cell]
    if s != NOBODY and region_count[s] > 0:
        o = boxes.origin[s]
        x = away(s, solid_position, boxes)
        c = region_place(s, x, region_center)
        w = exact(region_spin[s])
        for i in range(3):
            row[cell, i] = w[i]
            j, k = (i + 1) % 3, (i + 2) % 3
            v = np.float64(region_velocity[s, i]) - np.float64(solid_velocity[o, i])
            row[cell, 3 + i] = v - (w[j] * c[k] - w[k] * c[j])
        row[cell, 6] = 1.0


@formula
def damp_sums(s, solid_position, solid_velocity, boxes, sums):
    """Sum over the box around node s of what regions would add to its velocity [m/s]; how many regions there are."""
    cell = boxes.cell[s]
    row = boxes.second
    x, u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned_by = row[cell, j] * x[k] - row[cell, k] * x[j]
        sums[i] = row[cell, 3 + i] + turned_by - row[cell, 6] * u[i]
    return row[cell, 6]


@formula
def axis_sum(cell, axis, half_width, count, side, source, target):
    """Sums of the 2 w + 1 cells around one along an axis, as far as the box goes."""
    stride = 1
    if axis == 0:
        stride = side[1] * side[2]
    elif axis == 1:
        stride = side[2]
    at = cell // stride % side[axis]
    low, high = max(at - half_width, 0), min(at + half_width, side[axis] - 1)
    for c in range(count):
        target[cell, c] = source[cell + (low - at) * stride, c]
    for other in range(low + 1, high + 1):
        for c in range(count):
            target[cell, c] += source[cell + (other - at) * stride, c]
