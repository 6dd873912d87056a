"""What one cell and one node do in fast summation; the CPU and the CUDA kernels share these. All sums in float64.

Positions, velocities and cells are taken from the node in the middle of the body: what sums of large numbers round
away shows in the momentum, because a body that keeps its shape rounds the same way in every step.
"""

import numpy as np

from refsim.compile import formula
from refsim.shape_matching.formulas import turned
from refsim.shape_matching.phases import NOBODY


@formula
def from_middle(s, boxes):
    """(a, b, e): cell of node s from that of its body's middle node."""
    cell, middle = boxes.cell[s], boxes.cell[boxes.origin[s]]
    plane, row = boxes.side[1] * boxes.side[2], boxes.side[2]
    return (
        float(cell % row - middle % row),
        float(cell // row % boxes.side[1] - middle // row % boxes.side[1]),
        float(cell // plane - middle // plane),
    )


@formula
def exact(row):
    """Three components in float64; `float` would leave a float32 as it is in compiled code."""
    return np.float64(row[0]), np.float64(row[1]), np.float64(row[2])


@formula
def away(s, values, boxes):
    """A node's position [m] or velocity [m/s] from that of its body's middle node, in float64."""
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
        row[c, cell] = 0.0


@formula
def match_cell(cell, solid_position, region_share, boxes):
    """m, m x, m g, m x g^T and the number of nodes in one cell."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != NOBODY and region_share[s] > 0:
        m = np.float64(region_share[s])
        g = from_middle(s, boxes)
        x = away(s, solid_position, boxes)
        row[0, cell], row[16, cell] = m, 1.0
        for i in range(3):
            row[1 + i, cell], row[4 + i, cell] = m * x[i], m * g[i]
            for j in range(3):
                row[7 + 3 * i + j, cell] = m * x[i] * g[j]


@formula
def match_sums(s, solid_position, boxes, moments):
    """The sums of the box around node s, taken from the node instead of its body's middle one; how many nodes it has.

    moments (16,): m, m x, m g, m x g^T.
    """
    cell = boxes.cell[s]
    row = boxes.second
    g = from_middle(s, boxes)
    x = away(s, solid_position, boxes)
    m = row[0, cell]
    moments[0] = m
    for i in range(3):
        moments[1 + i] = row[1 + i, cell] - m * x[i]
        moments[4 + i] = row[4 + i, cell] - m * g[i]
        for j in range(3):
            about = row[7 + 3 * i + j, cell] - row[1 + i, cell] * g[j]
            moments[7 + 3 * i + j] = about - x[i] * (row[4 + j, cell] - m * g[j])
    return row[16, cell]


@formula
def goal_cell(cell, solid_position, region_count, region_anchor, rotation, boxes, spacing):
    """R, and anchor + x - R d g, of the region of the node in one cell; and their number."""
    row = boxes.first
    clear(cell, row, 13)
    s = boxes.node[cell]
    if s != NOBODY and region_count[s] > 0:
        a, b, e = from_middle(s, boxes)
        x = away(s, solid_position, boxes)
        d = np.float64(spacing)
        i, j, k = exact(rotation[s, 1:])
        q = (np.float64(rotation[s, 0]), i, j, k)
        first, second, third = turned(q, 1.0, 0.0, 0.0), turned(q, 0.0, 1.0, 0.0), turned(q, 0.0, 0.0, 1.0)
        for i in range(3):
            row[3 * i, cell], row[3 * i + 1, cell], row[3 * i + 2, cell] = first[i], second[i], third[i]
            there = d * (first[i] * a + second[i] * b + third[i] * e)
            row[9 + i, cell] = np.float64(region_anchor[s, i]) + x[i] - there
        row[12, cell] = 1.0


@formula
def goal_sums(s, solid_position, boxes, spacing, sums):
    """Sum over the box around node s of the ways to where its regions take it [m]; how many regions there are."""
    cell = boxes.cell[s]
    row = boxes.second
    a, b, e = from_middle(s, boxes)
    x = away(s, solid_position, boxes)
    d = np.float64(spacing)
    for i in range(3):
        turned_by = row[3 * i, cell] * a + row[3 * i + 1, cell] * b + row[3 * i + 2, cell] * e
        sums[i] = row[9 + i, cell] + d * turned_by - row[12, cell] * x[i]
    return row[12, cell]


@formula
def motion_cell(cell, solid_position, solid_velocity, region_share, boxes):
    """m, m x, m v, m x x v, m x x^T (xx, yy, zz, xy, xz, yz) of one cell, and the number of nodes in it."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != NOBODY and region_share[s] > 0:
        m = np.float64(region_share[s])
        x, v = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
        row[0, cell], row[16, cell] = m, 1.0
        for i in range(3):
            row[1 + i, cell], row[4 + i, cell] = m * x[i], m * v[i]
            row[10 + i, cell] = m * x[i] * x[i]
        row[7, cell] = m * (x[1] * v[2] - x[2] * v[1])
        row[8, cell] = m * (x[2] * v[0] - x[0] * v[2])
        row[9, cell] = m * (x[0] * v[1] - x[1] * v[0])
        row[13, cell], row[14, cell], row[15, cell] = m * x[0] * x[1], m * x[0] * x[2], m * x[1] * x[2]


@formula
def motion_sums(s, solid_position, solid_velocity, region_center, boxes, sums):
    """The sums of the box around node s about its region's center, velocities from the node's; how many nodes it has.

    sums (13,): m v, m r x v, m r r^T (xx, yy, zz, xy, xz, yz), m.
    """
    cell = boxes.cell[s]
    row = boxes.second
    x, u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    c = region_place(s, x, region_center)
    m = row[0, cell]
    arm = (row[1, cell] - m * c[0], row[2, cell] - m * c[1], row[3, cell] - m * c[2])  # sum m r
    p = (row[4, cell], row[5, cell], row[6, cell])  # sum m v, from the body's middle node
    sums[0], sums[1], sums[2] = p[0] - m * u[0], p[1] - m * u[1], p[2] - m * u[2]
    sums[3] = row[7, cell] - (c[1] * p[2] - c[2] * p[1]) - (arm[1] * u[2] - arm[2] * u[1])
    sums[4] = row[8, cell] - (c[2] * p[0] - c[0] * p[2]) - (arm[2] * u[0] - arm[0] * u[2])
    sums[5] = row[9, cell] - (c[0] * p[1] - c[1] * p[0]) - (arm[0] * u[1] - arm[1] * u[0])
    for i in range(3):
        sums[6 + i] = row[10 + i, cell] - c[i] * (row[1 + i, cell] + arm[i])
    sums[9] = row[13, cell] - c[0] * row[2, cell] - arm[0] * c[1]
    sums[10] = row[14, cell] - c[0] * row[3, cell] - arm[0] * c[2]
    sums[11] = row[15, cell] - c[1] * row[3, cell] - arm[1] * c[2]
    sums[12] = m
    return row[16, cell]


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
            row[i, cell] = w[i]
            j, k = (i + 1) % 3, (i + 2) % 3
            v = np.float64(region_velocity[s, i]) - np.float64(solid_velocity[o, i])
            row[3 + i, cell] = v - (w[j] * c[k] - w[k] * c[j])
        row[6, cell] = 1.0


@formula
def damp_sums(s, solid_position, solid_velocity, boxes, sums):
    """Sum over the box around node s of what regions would add to its velocity [m/s]; how many regions there are."""
    cell = boxes.cell[s]
    row = boxes.second
    x, u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turned_by = row[j, cell] * x[k] - row[k, cell] * x[j]
        sums[i] = row[3 + i, cell] + turned_by - row[6, cell] * u[i]
    return row[6, cell]


@formula
def stride_of(axis, side):
    """How far apart neighbouring cells along an axis stand."""
    if axis == 0:
        return side[1] * side[2]
    if axis == 1:
        return side[2]
    return 1


@formula
def axis_sum(c, cell, stride, half_width, source, target):
    """Sum of number c over the 2 w + 1 cells around one along an axis, whose cells stand `stride` apart."""
    total = source[c, cell]
    for k in range(1, half_width + 1):
        total += source[c, cell - k * stride] + source[c, cell + k * stride]
    target[c, cell] = total
