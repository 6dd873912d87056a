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
from refsim.backends.tuples import added, converted, cross, difference, outer, scaled, times, transposed
from refsim.shape_matching import kernels
from refsim.shape_matching.formulas import match_term, motion_term, turned
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
    return difference(exact(values[s]), exact(values[boxes.origin[s]]))


@formula
def clear(cell, row, count):
    """No terms."""
    for c in range(count):
        row[c, cell] = 0.0


@formula
def write(cell, row, terms):
    """The terms of one cell."""
    for c in range(len(terms)):
        row[c, cell] = terms[c]


@formula
def three_at(c, cell, row):
    """Numbers c to c + 2 of one cell."""
    return row[c, cell], row[c + 1, cell], row[c + 2, cell]


@formula
def nine_at(c, cell, row):
    """Numbers c to c + 8 of one cell."""
    return *three_at(c, cell, row), *three_at(c + 3, cell, row), *three_at(c + 6, cell, row)


@kernel(rows_of="node", ordered=True)
def match_cells(cell, solid_position, region_share, boxes, node):
    """m, m x, m g, m x g^T and the number of nodes in one cell."""
    clear(cell, boxes.first, 17)
    s = boxes.node[cell]
    if s != EMPTY and region_share[s] > 0:
        term = match_term(np.float64(region_share[s]), away(s, solid_position, boxes), from_middle(s, boxes))
        write(cell, boxes.first, (*term, 1.0))


@formula
def match_box(s, solid_position, boxes):
    """How many nodes stand in the box around node s, and its sums, taken from the node, not from its body's middle one.

    Sums of m, m x, m g, m x g^T, in the positions' precision.
    """
    cell, row, g, x = boxes.cell[s], boxes.second, from_middle(s, boxes), away(s, solid_position, boxes)
    m, mx, mg = row[0, cell], three_at(1, cell, row), three_at(4, cell, row)
    own = difference(mg, scaled(g, m))
    products = difference(difference(nine_at(7, cell, row), outer(mx, g)), outer(x, own))
    sums = m, *difference(mx, scaled(x, m)), *own, *products
    return row[16, cell], converted(sums, type(solid_position[s, 0]))


@kernel(rows_of="node", ordered=True)
def goal_cells(cell, solid_position, goals, boxes, spacing, node):
    """R, and anchor + x - R d g, of the region of the node in one cell; and their number."""
    clear(cell, boxes.first, 13)
    s = boxes.node[cell]
    if s != EMPTY and goals.region_count[s] > 0:
        q = np.float64(goals.rotation[s, 0]), *exact(goals.rotation[s, 1:])
        columns = *turned(q, (1.0, 0.0, 0.0)), *turned(q, (0.0, 1.0, 0.0)), *turned(q, (0.0, 0.0, 1.0))
        turn, place = transposed(columns), added(exact(goals.region_anchor[s]), away(s, solid_position, boxes))
        there = scaled(times(turn, from_middle(s, boxes)), np.float64(spacing))
        write(cell, boxes.first, (*turn, *difference(place, there), 1.0))


@formula
def goal_box(s, solid_position, boxes, spacing):
    """How many regions stand in the box around node s, and the sum of its displacements to its goals in them [m]."""
    cell, row = boxes.cell[s], boxes.second
    count, there = row[12, cell], times(nine_at(0, cell, row), from_middle(s, boxes))
    goals = added(three_at(9, cell, row), scaled(there, np.float64(spacing)))
    goals = difference(goals, scaled(away(s, solid_position, boxes), count))
    return count, converted(goals, type(solid_position[s, 0]))


@kernel(rows_of="node", ordered=True)
def motion_cells(cell, solid_position, solid_velocity, region_share, boxes, node):
    """m, m x, m v, m x x v, m x x^T (xx, xy, xz, yy, yz, zz) of one cell, and the number of nodes in it."""
    clear(cell, boxes.first, 17)
    s = boxes.node[cell]
    if s != EMPTY and region_share[s] > 0:
        m, x = np.float64(region_share[s]), away(s, solid_position, boxes)
        term = motion_term(m, x, away(s, solid_velocity, boxes))
        write(cell, boxes.first, (m, *scaled(x, m), *term, 1.0))


@formula
def motion_box(s, solid_position, solid_velocity, region_center, boxes):
    """How many nodes stand in the box around node s, their mass, and sums about its region's center.

    Sums of m v, m r x v, m r r^T (xx, xy, xz, yy, yz, zz), velocities from the node's, in the positions' precision.
    """
    real, cell, row, u = type(solid_position[s, 0]), boxes.cell[s], boxes.second, away(s, solid_velocity, boxes)
    c = added(away(s, solid_position, boxes), exact(region_center[s]))
    m, mx, mv = row[0, cell], three_at(1, cell, row), three_at(4, cell, row)  # from the body's middle node
    mr = difference(mx, scaled(c, m))
    spin = difference(difference(three_at(7, cell, row), cross(c, mv)), cross(mr, u))
    sums = (
        *difference(mv, scaled(u, m)), *spin, row[10, cell] - c[0] * (mx[0] + mr[0]),
        row[11, cell] - c[0] * mx[1] - mr[0] * c[1], row[12, cell] - c[0] * mx[2] - mr[0] * c[2],
        row[13, cell] - c[1] * (mx[1] + mr[1]), row[14, cell] - c[1] * mx[2] - mr[1] * c[2],
        row[15, cell] - c[2] * (mx[2] + mr[2]),
    )  # fmt: skip
    return row[16, cell], real(m), converted(sums, real)


@formula
def too_small(mass, sums, matching):
    """Whether a region has shrunk so far that the rounding of its box's sums, which grows with the body, exceeds them.

    Sums of boxes round about eps64 m L^2 away, L the distance from the body's middle; sum m r^2 of a region in its
    shape is d^2 m or more. Members that coincide have none.
    """
    return not sums[6] + sums[9] + sums[11] >= type(mass)(0.01) * mass * matching.spacing * matching.spacing


@kernel(rows_of="node", ordered=True)
def damp_cells(cell, solid_position, solid_velocity, motions, boxes, node):
    """omega, and v - omega x (x + center), of the region of the node in one cell; and their number."""
    clear(cell, boxes.first, 7)
    s = boxes.node[cell]
    if s != EMPTY and motions.region_count[s] > 0:
        spin, middle = exact(motions.region_spin[s]), exact(solid_velocity[boxes.origin[s]])
        c = added(away(s, solid_position, boxes), exact(motions.region_center[s]))
        v = difference(difference(exact(motions.region_velocity[s]), middle), cross(spin, c))
        write(cell, boxes.first, (*spin, *v, 1.0))


@formula
def damp_box(s, solid_position, solid_velocity, boxes):
    """How many regions stand in the box around node s, and the sum of what they would add to its velocity [m/s]."""
    cell, row, u = boxes.cell[s], boxes.second, away(s, solid_velocity, boxes)
    count, spun = row[6, cell], cross(three_at(0, cell, row), away(s, solid_position, boxes))
    more = difference(added(three_at(3, cell, row), spun), scaled(u, count))
    return count, converted(more, type(solid_position[s, 0]))


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


@kernel(rows_of="terms", ordered=True, allocates=True)
def sum_planes(c, half_width, boxes, terms):
    """Sums over the box around every node of number c of `terms`, the first rows of boxes.first, into boxes.second.

    Along rows and across them in each plane, then over planes; only where there are nodes to sum for, and a few planes
    at a time, which stay in the cache.
    """
    source, target, planes, columns = terms[c], boxes.second[c], boxes.planes, boxes.side[2]
    area, window = boxes.side[1] * columns, 2 * half_width + 1
    lines, sums = np.zeros(area), np.zeros((window, area))
    for p in range(planes.shape[0]):
        # unsigned: indices that may be negative cost a test each, and loops over them do not vectorise
        low, high = np.uint64(planes[p, 6]), np.uint64(planes[p, 7])
        for row in range(planes[p, 2], planes[p, 3]):
            at = np.uint64(row * columns)
            there = np.uint64(p * area + row * columns)
            for x in range(low, high):
                lines[at + x] = source[there + x]
            for k in range(np.uint64(1), np.uint64(half_width + 1)):
                for x in range(low, high):
                    lines[at + x] += source[there + x - k] + source[there + x + k]
        plane = sums[p % window]
        for row in range(planes[p, 4], planes[p, 5]):
            at = np.uint64(row * columns)
            for x in range(low, high):
                plane[at + x] = 0.0
            for near in range(max(row - half_width, planes[p, 2]), min(row + half_width + 1, planes[p, 3])):
                beside = np.uint64(near * columns)
                for x in range(low, high):
                    plane[at + x] += lines[beside + x]
        middle = p - half_width
        if middle >= 0:
            start = middle * area
            for s in range(planes[middle, 0], planes[middle, 1]):
                total = 0.0
                cell = np.uint64(boxes.cell[s] - start)
                for k in range(window):
                    total += sums[np.uint64(k), cell]
                target[boxes.cell[s]] = total
