"""What one node does in lattice shape matching; threads of a GPU share a region (Shao & Song 2017, section 3.2).

Tables have a row for each node in the particles' first order, in which the nodes of solids come first: row s belongs to
the particle of identity s, whose present row in the particle arrays is place[s]. Empty slots are EMPTY.
"""

import numpy as np

from refsim.backends.compile import formula, kernel
from refsim.backends.runtime import simulated
from refsim.backends.tuples import added, converted, difference, entrywise, over, put, scaled, three
from refsim.neighbours.formulas import BITS, lower_bound
from refsim.neighbours.rows import first_lane, lane_slots, over_lanes
from refsim.shape_matching import formulas
from refsim.shape_matching.phases import EMPTY, FLUID, INTERIOR, SURFACE
from refsim.shape_matching.rotation import solved_rotation

LANES = 1 if simulated() else 8  # CUDA threads that share a region; the simulator has no shuffles
SMALL = 1e-3  # of M d: where A is below, positions have come together, and it is summed with care
EPSILON = 2.220446049250313e-16  # of float64


@formula
def find(key, wanted, first, end):
    """Place of `wanted` among the sorted keys [first, end); EMPTY if it is absent."""
    low = first + lower_bound(key[first:end], wanted)
    particle = EMPTY
    if low < end and key[low] == wanted:
        particle = low
    return particle


@kernel(ordered=True)
def direct_neighbours(s, phase, place, lattice, direct):
    """27 direct neighbours of node s, itself in slot 13: solid, same body, at most one cell away; dimensionless."""
    solid = phase[place[s]] != FLUID
    body = lattice.body[s]
    first, end = lattice.first[body], lattice.first[body + 1]
    for slot in range(27):
        a, b, e = formulas.slot_offset(slot, 1)
        other = EMPTY
        if solid:
            key = lattice.key[s] + (e << (2 * BITS)) + (b << BITS) + a
            other = find(lattice.key, key, first, end)
            if other != EMPTY and phase[place[other]] == FLUID:
                other = EMPTY
        direct[s, slot] = other


@kernel(ordered=True)
def classify(i, identity, direct, lattice, phase):
    """Phase of particle i, if it is a node: at its body's surface if a direct neighbour is missing; a flag."""
    if identity[i] < direct.shape[0]:
        s = identity[i]
        kind = FLUID
        if direct[s, 13] != EMPTY:
            beside = 0
            for slot in range(27):
                if direct[s, slot] != EMPTY:
                    beside += 1
            kind = SURFACE if beside < (27 if lattice.dim == 3 else 9) else INTERIOR
        phase[i] = kind


@kernel(ordered=True)
def gather(s, position, mass, place, region_count, region_share, solid_position):
    """Position [m] of node s and its share m_k/cnt_k in each of its regions [kg]."""
    i = place[s]
    for c in range(3):
        solid_position[s, c] = position[i, c]
    count = region_count[s]
    region_share[s] = mass[i] / type(mass[i])(count) if count > 0 else type(mass[i])(0)


@formula
def opposites(pair, lane, half_width):
    """(slot, the one opposite, (a, b, e)): a pair of slots and the first one's offset [cells].

    Opposite slots are summed one after the other, so that sums stay small.
    """
    if lane is None:
        return pair, (2 * half_width + 1) ** 3 - 1 - pair, formulas.slot_offset(pair, half_width)
    return opposites_of_lane(pair, half_width)


@formula
def opposites_of_lane(pair, half_width):
    """As `opposites`, where successive pairs are neighbours along x, as nodes are in memory."""
    n = np.uint32(2 * half_width + 1)
    over = (np.uint32(1 << 16) + n - np.uint32(1)) // n  # times a number below 2^13: 2^16 of its whole quotient by n
    column = (np.uint32(pair) * over) >> np.uint32(16)
    plane = (column * over) >> np.uint32(16)
    a, b = np.int32(np.uint32(pair) - column * n), np.int32(column - plane * n)
    plane = np.int32(plane)
    slot = (a * np.int32(n) + b) * np.int32(n) + plane
    last = np.int32(n) * np.int32(n) * np.int32(n) - 1
    return slot, last - slot, (a - half_width, b - half_width, plane - half_width)


@formula
def opposite(offset):
    """The offset of the opposite slot."""
    return -offset[0], -offset[1], -offset[2]


@entrywise
def _of_lanes(part, lane, lanes):
    return over_lanes(part, (lane, lanes))


@formula
def summed(sums, lane):
    """Sums of what the lanes hold."""
    return sums if lane is None else _of_lanes(sums, lane[0], lane[1])


@formula
def over_region(term, sums, s, lane, region, half_width, nodes):
    """`sums` and the terms of all members of the region of node s, or of all regions that hold it."""
    (first, step), middle = lane_slots(lane), region.shape[1] // 2
    for pair in range(first, middle + 1, step):
        slot, other, offset = opposites(pair, lane, half_width)
        j, k = region[s, slot], region[s, other]  # both are on their way before one is used
        if j != EMPTY:
            sums = added(sums, term(s, j, offset, nodes))
        if k != EMPTY and pair < middle:
            sums = added(sums, term(s, k, opposite(offset), nodes))
    return summed(sums, lane)


@formula
def no_members(zero):
    """Sums of no terms."""
    return formulas.match_term(zero, (zero, zero, zero), (zero, zero, zero))


@formula
def match_member(s, j, offset, nodes):
    """Terms of member j of the region of node s, `offset` cells from it."""
    solid_position, region_share = nodes
    x = difference(three(solid_position, j), three(solid_position, s))
    return formulas.match_term(region_share[j], x, converted(offset, type(x[0])))


@kernel(lanes=LANES, registers=64, ordered=True)
def match(s, lane, solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center [m], anchor [m] and rotation of the region of node s, summed member by member."""
    sums = match_sums(s, lane, solid_position, region_share, region, matching.half_width)
    if first_lane(lane):
        match_end(s, sums, solid_position, region_share, region, matching, region_center, region_anchor, rotation)


@formula
def match_sums(s, lane, solid_position, region_share, region, half_width):
    """Sums of the region of node s, member by member."""
    nothing = no_members(type(solid_position[s, 0])(0))
    return over_region(match_member, nothing, s, lane, region, half_width, (solid_position, region_share))


@formula
def careful_sums(s, solid_position, region_share, region, half_width):
    """(sums, S = sum m |x|_1 [kg m]) of the region of node s, member by member in float64, with exact differences."""
    zero = np.float64(0)
    sums, size = no_members(zero), zero
    last = region.shape[1] - 1
    for k in range(region.shape[1]):  # a slot and then its opposite: k = 0, last, 1, ...
        slot = last - k // 2 if k % 2 else k // 2
        j = region[s, slot]
        if j != EMPTY:
            m, g = np.float64(region_share[j]), converted(formulas.slot_offset(slot, half_width), np.float64)
            there, here = three(solid_position, j), three(solid_position, s)
            x = difference(converted(there, np.float64), converted(here, np.float64))
            sums = added(sums, formulas.match_term(m, x, g))
            size += m * (abs(x[0]) + abs(x[1]) + abs(x[2]))
    return sums, size


@formula
def match_end(s, sums, solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of the region of node s, from its sums; of an empty one the node's own position.

    If Newton's steps find no rotation the region is summed again in float64. The rounding error of n terms is at most
    n eps sum |terms| in an entry of A, in any order, and sum |terms| <= 2 w S. Below that, and below the error that
    the positions' rounding makes, A determines no rotation.
    """
    real, half_width = type(sums[0]), matching.half_width
    far = abs(solid_position[s, 0]) + abs(solid_position[s, 1]) + abs(solid_position[s, 2])
    doubt = matching.eps * real(half_width) * far  # of an entry of A/M [m], by rounding of the positions
    least = real(SMALL) * matching.spacing + real(16) * doubt
    near, q = formulas.quick_rotation(sums, rotation[s], sums[0] * least, matching.precision)
    if not near:
        exact, size = careful_sums(s, solid_position, region_share, region, half_width)
        n, w = np.float64(region.shape[1]), np.float64(half_width)
        lost = 2 * w * n * EPSILON * size + exact[0] * np.float64(doubt)
        before = converted((rotation[s, 0], rotation[s, 1], rotation[s, 2], rotation[s, 3]), np.float64)
        q = converted(solved_rotation(exact, before, np.float64(matching.twist_floor), lost), real)
        sums = converted(exact, real)
    zero = real(0)
    center, anchor = (zero, zero, zero), (zero, zero, zero)
    if sums[0] > zero:
        put(rotation, s, q)
        center = over(sums[1:4], sums[0])
        anchor = difference(center, formulas.turned(q, scaled(sums[4:7], matching.spacing / sums[0])))
    put(region_center, s, center)
    put(region_anchor, s, anchor)


@formula
def goal_member(s, r, offset, nodes):
    """Displacement of node s to its goal in the region of node r [m]; r is `offset` cells from s."""
    solid_position, region_anchor, rotation, matching = nodes
    g = converted(offset, type(matching.spacing))
    goal = formulas.goal_term(rotation[r], region_anchor[r], g, matching.spacing)
    return added(goal, difference(three(solid_position, r), three(solid_position, s)))


@kernel(lanes=LANES, ordered=True)
def pull(
    s, lane, velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Pull of node s towards its goal [m/s^2], summed member by member; added to the acceleration."""
    sums = goal_sums(s, lane, solid_position, region, region_anchor, rotation, matching)
    if first_lane(lane):
        goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@formula
def goal_sums(s, lane, solid_position, region, region_anchor, rotation, matching):
    """Sum of `goal_member` over the slots, member by member [m]."""
    zero, nodes = type(matching.spacing)(0), (solid_position, region_anchor, rotation, matching)
    return over_region(goal_member, (zero, zero, zero), s, lane, region, matching.half_width, nodes)


@formula
def goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity):
    """Pull of node s towards its goal, added to its acceleration [m/s^2], and its velocity after the kick [m/s]."""
    i = place[s]
    count = type(matching.spacing)(region_count[s])
    for c in range(3):
        if count > 0 and timestep[1] > 0:
            acceleration[i, c] += formulas.pull(sums[c] / count, matching.stiffness, timestep)
        solid_velocity[s, c] = velocity[i, c] + timestep[0] * acceleration[i, c]


@formula
def motion_member(s, j, offset, nodes):
    """Mass of member j, and its terms in the motion of the region of node s. Velocities relative to node s."""
    solid_position, solid_velocity, region_share, region_center = nodes
    r = difference(three(solid_position, j), three(solid_position, s))
    u = difference(three(solid_velocity, j), three(solid_velocity, s))
    return region_share[j], *formulas.motion_term(region_share[j], difference(r, three(region_center, s)), u)


@kernel(lanes=LANES, ordered=True)
def region_motion(
    s, lane, solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):
    """Velocity [m/s] and spin [1/s] of the region of node s, summed member by member."""
    mass, sums = motion_sums(s, lane, solid_position, solid_velocity, region_share, region, region_center, matching)
    if first_lane(lane):
        motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@formula
def motion_sums(s, lane, solid_position, solid_velocity, region_share, region, region_center, matching):
    """Mass [kg] of the region of node s, and the sums of its motion, member by member."""
    zero, nodes = type(region_center[s, 0])(0), (solid_position, solid_velocity, region_share, region_center)
    nothing = zero, *formulas.motion_term(zero, (zero, zero, zero), (zero, zero, zero))
    sums = over_region(motion_member, nothing, s, lane, region, matching.half_width, nodes)
    return sums[0], sums[1:]


@formula
def motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin):
    """Velocity [m/s] and spin [1/s] of the region of node s, from its sums; an empty one has the node's velocity."""
    zero = type(mass)(0)
    v, spin = (zero, zero, zero), (zero, zero, zero)
    if mass > zero:
        v, spin = formulas.rigid_motion(mass, sums, matching.inertia_floor)
    for c in range(3):
        region_velocity[s, c] = solid_velocity[s, c] + v[c]
        region_spin[s, c] = spin[c]


@formula
def damp_member(s, r, offset, nodes):
    """Velocity of node s in the rigid motion of the region of node r less its own [m/s]."""
    solid_position, solid_velocity, region_center, region_velocity, region_spin = nodes
    arm = difference(difference(three(solid_position, s), three(solid_position, r)), three(region_center, r))
    return difference(formulas.rigid_term(region_velocity[r], region_spin[r], arm), three(solid_velocity, s))


@kernel(rows_of="region_count", lanes=LANES, ordered=True)
def damp(
    s, lane, solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place,
    matching, timestep, acceleration,
):  # fmt: skip
    """Damping of node s towards the rigid motion of its regions [m/s^2]; added to the acceleration."""
    nodes = solid_position, solid_velocity, region_center, region_velocity, region_spin
    sums = damp_sums(s, lane, region, nodes, matching.half_width)
    if first_lane(lane):
        damp_end(s, sums, region_count, place, matching, timestep, acceleration)


@formula
def damp_sums(s, lane, region, nodes, half_width):
    """Sum of `damp_member` over the slots, member by member [m/s]."""
    zero = type(nodes[0][s, 0])(0)
    return over_region(damp_member, (zero, zero, zero), s, lane, region, half_width, nodes)


@formula
def damp_end(s, sums, region_count, place, matching, timestep, acceleration):
    """Damping of node s, added to its acceleration: v += (beta/cnt) sum."""
    if region_count[s] > 0 and timestep[0] > 0:
        i = place[s]
        share = matching.damping / (type(matching.damping)(region_count[s]) * timestep[0])
        for c in range(3):
            acceleration[i, c] += share * sums[c]
