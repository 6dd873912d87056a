"""Region sums by parallel reduction: neighbouring threads share a region (Shao & Song 2017, section 3.2)."""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.backends.primitives import sum_of_lanes
from refsim.backends.tuples import added, entrywise
from refsim.shape_matching import kernels
from refsim.shape_matching.phases import EMPTY


@formula
def _opposites(pair, half_width):
    """(slot, the one opposite, (a, b, e)): a pair of slots and the first one's offset [cells].

    Successive pairs are neighbours along x, as nodes are in memory. Opposite slots are summed one after the other, so
    that sums stay small.
    """
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
def _opposite(offset):
    """The offset of the opposite slot."""
    return -offset[0], -offset[1], -offset[2]


@entrywise
def _summed(part, lane):
    """Sums of what the lanes hold."""
    return sum_of_lanes(part, lane, kernels.LANES)


@cuda_kernel(lanes=kernels.LANES, registers=64)
def match(solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    s, lane = cuda.grid(1) // kernels.LANES, cuda.grid(1) % kernels.LANES
    if s < rotation.shape[0]:
        middle = region.shape[1] // 2
        sums = kernels.nothing_16(rotation.dtype.type(0))
        for pair in range(lane, middle + 1, kernels.LANES):
            slot, other, offset = _opposites(pair, matching.half_width)
            j = region[s, slot]
            if j != EMPTY:
                sums = added(sums, kernels.match_member(s, j, offset, solid_position, region_share))
            j = region[s, other]
            if j != EMPTY and pair < middle:
                terms = kernels.match_member(s, j, _opposite(offset), solid_position, region_share)
                sums = added(sums, terms)
        sums = _summed(sums, lane)
        if lane == 0:
            places = region_center, region_anchor, rotation
            kernels.match_end(s, sums, solid_position, region_share, region, matching, *places)


@cuda_kernel(lanes=kernels.LANES)
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    s, lane = cuda.grid(1) // kernels.LANES, cuda.grid(1) % kernels.LANES
    if s < solid_velocity.shape[0]:
        middle = region.shape[1] // 2
        zero = rotation.dtype.type(0)
        goals = zero, zero, zero
        for pair in range(lane, middle + 1, kernels.LANES):
            slot, other, offset = _opposites(pair, matching.half_width)
            r = region[s, slot]
            if r != EMPTY:
                goal = kernels.goal_member(s, r, offset, solid_position, region_anchor, rotation, matching)
                goals = added(goals, goal)
            r = region[s, other]
            if r != EMPTY and pair < middle:
                goal = kernels.goal_member(s, r, _opposite(offset), solid_position, region_anchor, rotation, matching)
                goals = added(goals, goal)
        sums = _summed(goals, lane)
        if lane == 0:
            kernels.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cuda_kernel(lanes=kernels.LANES)
def region_motion(
    solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):  # fmt: skip
    """Velocity and spin of every region."""
    s, lane = cuda.grid(1) // kernels.LANES, cuda.grid(1) % kernels.LANES
    if s < region_spin.shape[0]:
        middle = region.shape[1] // 2
        mass = region_spin.dtype.type(0)
        sums = kernels.nothing_12(mass)
        for pair in range(lane, middle + 1, kernels.LANES):
            slot, other, _ = _opposites(pair, matching.half_width)
            if region[s, slot] != EMPTY:
                mass += region_share[region[s, slot]]
                own = kernels.motion_slot(s, slot, solid_position, solid_velocity, region_share, region, region_center)
                sums = added(sums, own)
            if region[s, other] != EMPTY and pair < middle:
                mass += region_share[region[s, other]]
                own = kernels.motion_slot(s, other, solid_position, solid_velocity, region_share, region, region_center)
                sums = added(sums, own)
        mass, sums = sum_of_lanes(mass, lane, kernels.LANES), _summed(sums, lane)
        if lane == 0:
            kernels.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@cuda_kernel(rows_of="region_count", lanes=kernels.LANES)
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    s, lane = cuda.grid(1) // kernels.LANES, cuda.grid(1) % kernels.LANES
    if s < region_count.shape[0]:
        middle = region.shape[1] // 2
        zero = acceleration.dtype.type(0)
        sums = zero, zero, zero
        regions = region, region_center, region_velocity, region_spin
        for pair in range(lane, middle + 1, kernels.LANES):
            slot, other, _ = _opposites(pair, matching.half_width)
            sums = added(sums, kernels.damp_slot(s, slot, solid_position, solid_velocity, *regions))
            if pair < middle:
                sums = added(sums, kernels.damp_slot(s, other, solid_position, solid_velocity, *regions))
        sums = _summed(sums, lane)
        if lane == 0:
            kernels.damp_end(s, sums, region_count, place, matching, timestep, acceleration)
