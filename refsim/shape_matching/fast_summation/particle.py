"""What one cell and one node do in fast summation; the CPU and the CUDA kernels share these. All sums in float64.

Positions, velocities and cells are taken from the node in the middle of the body: what sums of large numbers round
away shows in the momentum, because a body that keeps its shape rounds the same way in every step.
"""

import numpy as np

from refsim.backends.compile import formula
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
def match_sums(s, solid_position, boxes):
    """How many nodes stand in the box around node s, and its sums, taken from the node, not from its body's middle one.

    Sums of m, m x, m g, m x g^T, in the positions' precision.
    """
    real = type(solid_position[s, 0])
    cell = boxes.cell[s]
    row = boxes.second
    g = from_middle(s, boxes)
    x, y, z = away(s, solid_position, boxes)
    m = row[0, cell]
    mx, my, mz = row[1, cell], row[2, cell], row[3, cell]
    ga, gb, ge = row[4, cell] - m * g[0], row[5, cell] - m * g[1], row[6, cell] - m * g[2]
    sums = (
        real(m), real(mx - m * x), real(my - m * y), real(mz - m * z), real(ga), real(gb), real(ge),
        real(row[7, cell] - mx * g[0] - x * ga), real(row[8, cell] - mx * g[1] - x * gb),
        real(row[9, cell] - mx * g[2] - x * ge), real(row[10, cell] - my * g[0] - y * ga),
        real(row[11, cell] - my * g[1] - y * gb), real(row[12, cell] - my * g[2] - y * ge),
        real(row[13, cell] - mz * g[0] - z * ga), real(row[14, cell] - mz * g[1] - z * gb),
        real(row[15, cell] - mz * g[2] - z * ge),
    )  # fmt: skip
    return row[16, cell], sums


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
def goal_sums(s, solid_position, boxes, spacing):
    """How many regions stand in the box around node s, and the sum of the ways to where they take it [m]."""
    real = type(solid_position[s, 0])
    cell = boxes.cell[s]
    row = boxes.second
    a, b, e = from_middle(s, boxes)
    x, y, z = away(s, solid_position, boxes)
    d, n = np.float64(spacing), row[12, cell]
    gx = row[9, cell] + d * (row[0, cell] * a + row[1, cell] * b + row[2, cell] * e) - n * x
    gy = row[10, cell] + d * (row[3, cell] * a + row[4, cell] * b + row[5, cell] * e) - n * y
    gz = row[11, cell] + d * (row[6, cell] * a + row[7, cell] * b + row[8, cell] * e) - n * z
    return n, (real(gx), real(gy), real(gz))


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
def motion_sums(s, solid_position, solid_velocity, region_center, boxes):
    """How many nodes stand in the box around node s, their mass, and sums about its region's center.

    Sums of m v, m r x v, m r r^T (xx, yy, zz, xy, xz, yz), velocities from the node's, in the positions' precision.
    """
    real = type(solid_position[s, 0])
    cell = boxes.cell[s]
    row = boxes.second
    x, u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    c = region_place(s, x, region_center)
    m = row[0, cell]
    mx, my, mz = row[1, cell], row[2, cell], row[3, cell]
    rx, ry, rz = mx - m * c[0], my - m * c[1], mz - m * c[2]  # sum m r
    px, py, pz = row[4, cell], row[5, cell], row[6, cell]  # sum m v, from the body's middle node
    sums = (
        real(px - m * u[0]), real(py - m * u[1]), real(pz - m * u[2]),
        real(row[7, cell] - (c[1] * pz - c[2] * py) - (ry * u[2] - rz * u[1])),
        real(row[8, cell] - (c[2] * px - c[0] * pz) - (rz * u[0] - rx * u[2])),
        real(row[9, cell] - (c[0] * py - c[1] * px) - (rx * u[1] - ry * u[0])),
        real(row[10, cell] - c[0] * (mx + rx)), real(row[11, cell] - c[1] * (my + ry)),
        real(row[12, cell] - c[2] * (mz + rz)), real(row[13, cell] - c[0] * my - rx * c[1]),
        real(row[14, cell] - c[0] * mz - rx * c[2]), real(row[15, cell] - c[1] * mz - ry * c[2]),
    )  # fmt: skip
    return row[16, cell], real(m), sums


@formula
def too_small(mass, sums, matching):
    """Whether a region has shrunk so far that its box's sums, which hold the body's size, say nothing of its own.

    Sums of boxes round about eps64 m L^2 away, L the distance from the body's middle; sum m r^2 of a region in its
    shape is d^2 m or more. Members that coincide have none.
    """
    return not sums[6] + sums[7] + sums[8] >= type(mass)(0.01) * mass * matching.spacing * matching.spacing


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
def damp_sums(s, solid_position, solid_velocity, boxes):
    """How many regions stand in the box around node s, and the sum of what they would add to its velocity [m/s]."""
    real = type(solid_position[s, 0])
    cell = boxes.cell[s]
    row = boxes.second
    (x, y, z), u = away(s, solid_position, boxes), away(s, solid_velocity, boxes)
    wx, wy, wz, n = row[0, cell], row[1, cell], row[2, cell], row[6, cell]
    return n, (
        real(row[3, cell] + (wy * z - wz * y) - n * u[0]),
        real(row[4, cell] + (wz * x - wx * z) - n * u[1]),
        real(row[5, cell] + (wx * y - wy * x) - n * u[2]),
    )


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
