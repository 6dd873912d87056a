"""Region sums over boxes of cells, one axis after the other, after FastLSM (Rivers & James 2007).

A region whose members are all nodes of its body in the box of (2 w + 1)^3 cells around it is summed as 2 w + 1 sums of
planes of 2 w + 1 sums of rows of 2 w + 1 cells, which neighbouring regions share: 3 (2 w + 1) additions instead of
(2 w + 1)^3. Every other region is summed member by member.

All sums are in float64. Positions, velocities and cells are relative to the node in the middle of the body: rounding
of large sums would add to the momentum, because a body that keeps its shape rounds the same way in every step.

For a CPU, where a thread sums one number over all boxes.
"""

from collections import namedtuple

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.shape_matching import kernels
from refsim.shape_matching.formulas import turned
from refsim.shape_matching.phases import EMPTY

# Regions as the pull takes them
Goals = namedtuple("Goals", "region region_count region_anchor rotation")
# Regions as their motion takes them
Members = namedtuple("Members", "region_share region region_count region_center")
# Regions as the damping takes them
Motions = namedtuple("Motions", "region region_count region_center region_velocity region_spin")


def match(solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    match_cells(solid_position, region_share, boxes, boxes.node)
    sum_planes(matching.half_width, boxes, boxes.first[:17])
    match_nodes(
        solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
    )


def pull(velocity, solid_position, goals: Goals, place, boxes, matching, timestep, acceleration, solid_velocity):
    """Pull of every node towards its goal; added to the acceleration."""
    goal_cells(solid_position, goals, boxes, matching.spacing, boxes.node)
    sum_planes(matching.half_width, boxes, boxes.first[:13])
    goal_nodes(velocity, solid_position, goals, place, boxes, matching, timestep, acceleration, solid_velocity)


def region_motion(solid_position, solid_velocity, members: Members, boxes, matching, region_velocity, region_spin):
    """Velocity and spin of every region."""
    motion_cells(solid_position, solid_velocity, members.region_share, boxes, boxes.node)
    sum_planes(matching.half_width, boxes, boxes.first[:17])
    motion_nodes(solid_position, solid_velocity, members, boxes, matching, region_velocity, region_spin)


def damp(solid_position, solid_velocity, motions: Motions, place, boxes, matching, timestep, acceleration):
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    damp_cells(solid_position, solid_velocity, motions, boxes, boxes.node)
    sum_planes(matching.half_width, boxes, boxes.first[:7])
    count = motions.region_count
    damp_nodes(solid_position, solid_velocity, count, motions, place, boxes, matching, timestep, acceleration)


# Terms of the cells and sums of the boxes


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
    value, first = exact(values[s]), exact(values[boxes.origin[s]])
    return value[0] - first[0], value[1] - first[1], value[2] - first[2]


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


@kernel(rows_of="node", ordered=True)
def match_cells(cell, solid_position, region_share, boxes, node):
    """m, m x, m g, m x g^T and the number of nodes in one cell."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != EMPTY and region_share[s] > 0:
        m = np.float64(region_share[s])
        g = from_middle(s, boxes)
        x = away(s, solid_position, boxes)
        row[0, cell], row[16, cell] = m, 1.0
        for i in range(3):
            row[1 + i, cell], row[4 + i, cell] = m * x[i], m * g[i]
            for j in range(3):
                row[7 + 3 * i + j, cell] = m * x[i] * g[j]


@formula
def match_box(s, solid_position, boxes):
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


@kernel(rows_of="node", ordered=True)
def goal_cells(cell, solid_position, goals, boxes, spacing, node):
    """R, and anchor + x - R d g, of the region of the node in one cell; and their number."""
    row = boxes.first
    clear(cell, row, 13)
    s = boxes.node[cell]
    if s != EMPTY and goals.region_count[s] > 0:
        rotation = goals.rotation
        a, b, e = from_middle(s, boxes)
        x = away(s, solid_position, boxes)
        d = np.float64(spacing)
        i, j, k = exact(rotation[s, 1:])
        q = (np.float64(rotation[s, 0]), i, j, k)
        first, second, third = turned(q, (1.0, 0.0, 0.0)), turned(q, (0.0, 1.0, 0.0)), turned(q, (0.0, 0.0, 1.0))
        for i in range(3):
            row[3 * i, cell], row[3 * i + 1, cell], row[3 * i + 2, cell] = first[i], second[i], third[i]
            there = d * (first[i] * a + second[i] * b + third[i] * e)
            row[9 + i, cell] = np.float64(goals.region_anchor[s, i]) + x[i] - there
        row[12, cell] = 1.0


@formula
def goal_box(s, solid_position, boxes, spacing):
    """How many regions stand in the box around node s, and the sum of its displacements to its goals in them [m]."""
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


@kernel(rows_of="node", ordered=True)
def motion_cells(cell, solid_position, solid_velocity, region_share, boxes, node):
    """m, m x, m v, m x x v, m x x^T (xx, yy, zz, xy, xz, yz) of one cell, and the number of nodes in it."""
    row = boxes.first
    clear(cell, row, 17)
    s = boxes.node[cell]
    if s != EMPTY and region_share[s] > 0:
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
def motion_box(s, solid_position, solid_velocity, region_center, boxes):
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
    """Whether a region has shrunk so far that the rounding of its box's sums, which grows with the body, exceeds them.

    Sums of boxes round about eps64 m L^2 away, L the distance from the body's middle; sum m r^2 of a region in its
    shape is d^2 m or more. Members that coincide have none.
    """
    return not sums[6] + sums[7] + sums[8] >= type(mass)(0.01) * mass * matching.spacing * matching.spacing


@kernel(rows_of="node", ordered=True)
def damp_cells(cell, solid_position, solid_velocity, motions, boxes, node):
    """omega, and v - omega x (x + center), of the region of the node in one cell; and their number."""
    row = boxes.first
    clear(cell, row, 7)
    s = boxes.node[cell]
    if s != EMPTY and motions.region_count[s] > 0:
        o = boxes.origin[s]
        x = away(s, solid_position, boxes)
        c = region_place(s, x, motions.region_center)
        w = exact(motions.region_spin[s])
        for i in range(3):
            row[i, cell] = w[i]
            j, k = (i + 1) % 3, (i + 2) % 3
            v = np.float64(motions.region_velocity[s, i]) - np.float64(solid_velocity[o, i])
            row[3 + i, cell] = v - (w[j] * c[k] - w[k] * c[j])
        row[6, cell] = 1.0


@formula
def damp_box(s, solid_position, solid_velocity, boxes):
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


# Every node, from its box


@kernel(ordered=True)
def match_nodes(
    s, solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
):
    """Center, anchor and rotation of node s' region from its box or, if it is not the whole box, member by member."""
    counted, sums = match_box(s, solid_position, boxes)
    if counted != region_count[s] or counted <= 1:
        sums = kernels.match_sums(s, None, solid_position, region_share, region, matching.half_width)
    kernels.match_end(s, sums, solid_position, region_share, region, matching, region_center, region_anchor, rotation)


@kernel(ordered=True)
def goal_nodes(s, velocity, solid_position, goals, place, boxes, matching, timestep, acceleration, solid_velocity):
    """Pull of node s [m/s^2] from the sums of its box or, if its region is not the whole box, member by member."""
    counted, sums = goal_box(s, solid_position, boxes, matching.spacing)
    if counted != goals.region_count[s]:
        sums = kernels.goal_sums(s, None, solid_position, goals.region, goals.region_anchor, goals.rotation, matching)
    kernels.goal_end(s, sums, goals.region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@kernel(ordered=True)
def motion_nodes(s, solid_position, solid_velocity, members, boxes, matching, region_velocity, region_spin):
    """Velocity and spin of node s' region from its box or, if it is not the whole box, member by member."""
    share, region, count, center = members
    counted, mass, sums = motion_box(s, solid_position, solid_velocity, center, boxes)
    if counted != count[s] or counted <= 1 or too_small(mass, sums, matching):
        mass, sums = kernels.motion_sums(s, None, solid_position, solid_velocity, share, region, center, matching)
    kernels.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@kernel(rows_of="region_count", ordered=True)
def damp_nodes(
    s, solid_position, solid_velocity, region_count, motions, place, boxes, matching, timestep, acceleration
):
    """Damping of node s [m/s^2] from the sums of its box or, if its region is not the whole box, member by member."""
    counted, sums = damp_box(s, solid_position, solid_velocity, boxes)
    if counted != region_count[s]:
        region, _, center, mean, spin = motions
        nodes = solid_position, solid_velocity, center, mean, spin
        sums = kernels.damp_sums(s, None, region, nodes, matching.half_width)
    kernels.damp_end(s, sums, region_count, place, matching, timestep, acceleration)


@formula
def box_sums(source, target, half_width, boxes):
    """Sums of one number over the box around every node: along rows and across them in each plane, then over planes.

    Only where there are nodes to sum for, and a few planes at a time, which stay in the cache.
    """
    planes, columns = boxes.planes, boxes.side[2]
    area, window = boxes.side[1] * columns, 2 * half_width + 1
    lines, sums = np.zeros(area), np.zeros((window, area))
    for p in range(planes.shape[0]):
        # unsigned: indices that may be negative cost a test each, and loops over them do not vectorise
        low, high = np.uint64(planes[p, 6]), np.uint64(planes[p, 7])
        for row in range(planes[p, 2], planes[p, 3]):
            at = np.uint64(row * columns)
            there = np.uint64(p * area + row * columns)
            for c in range(low, high):
                lines[at + c] = source[there + c]
            for k in range(np.uint64(1), np.uint64(half_width + 1)):
                for c in range(low, high):
                    lines[at + c] += source[there + c - k] + source[there + c + k]
        plane = sums[p % window]
        for row in range(planes[p, 4], planes[p, 5]):
            at = np.uint64(row * columns)
            for c in range(low, high):
                plane[at + c] = 0.0
            for near in range(max(row - half_width, planes[p, 2]), min(row + half_width + 1, planes[p, 3])):
                beside = np.uint64(near * columns)
                for c in range(low, high):
                    plane[at + c] += lines[beside + c]
        middle = p - half_width
        if middle >= 0:
            start = middle * area
            for s in range(planes[middle, 0], planes[middle, 1]):
                total = 0.0
                cell = np.uint64(boxes.cell[s] - start)
                for k in range(window):
                    total += sums[np.uint64(k), cell]
                target[boxes.cell[s]] = total


@kernel(rows_of="terms", ordered=True, allocates=True)
def sum_planes(c, half_width, boxes, terms):
    """Sums over the box around every node of `terms`, the first rows of boxes.first, into number c of boxes.second."""
    box_sums(terms[c], boxes.second[c], half_width, boxes)
