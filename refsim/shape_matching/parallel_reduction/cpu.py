"""CPU kernels of shape matching with region sums by reduction: eight lanes share a region, then a tree adds them."""

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, prange
from refsim.shape_matching import particle
from refsim.shape_matching.phases import NOBODY

LANES = 8


@formula
def _tree(lanes):
    """Add the rows of `lanes` to the first, pair by pair."""
    half = LANES // 2
    while half > 0:
        for lane in range(half):
            for c in range(lanes.shape[1]):
                lanes[lane, c] += lanes[lane + half, c]
        half //= 2


@formula
def _match(s, solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """One region."""
    lanes = np.zeros((LANES, 16), rotation.dtype)
    for slot in range(region.shape[1]):
        terms = particle.match_slot(s, slot, solid_position, region_share, region, matching.half_width)
        for c, term in enumerate(terms):
            lanes[slot % LANES, c] += term
    _tree(lanes)
    matrix, basis = np.empty((4, 4), np.float64), np.empty((4, 4), np.float64)
    v = lanes[0]
    sums = (
        v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7], v[8], v[9], v[10], v[11], v[12], v[13], v[14], v[15],
    )  # fmt: skip
    particle.match_end(
        s, sums, solid_position, region_share, region, matching, matrix, basis, region_center, region_anchor, rotation
    )


@cpu_kernel(ordered=True)
def match(solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    for s in prange(rotation.shape[0]):
        _match(s, solid_position, region_share, region, matching, region_center, region_anchor, rotation)


@formula
def _pull(
    s, velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """One node."""
    lanes = np.zeros((LANES, 3), rotation.dtype)
    for slot in range(region.shape[1]):
        terms = particle.goal_slot(s, slot, solid_position, region, region_anchor, rotation, matching)
        for c, term in enumerate(terms):
            lanes[slot % LANES, c] += term
    _tree(lanes)
    particle.goal_end(s, lanes[0], region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cpu_kernel(ordered=True)
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    for s in prange(solid_velocity.shape[0]):
        _pull(
            s, velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep,
            acceleration, solid_velocity,
        )  # fmt: skip


@formula
def _region_motion(
    s, solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):  # fmt: skip
    """One region."""
    lanes = np.zeros((LANES, 13), region_spin.dtype)
    for slot in range(region.shape[1]):
        terms = particle.motion_slot(s, slot, solid_position, solid_velocity, region_share, region, region_center)
        for c, term in enumerate(terms):
            lanes[slot % LANES, c] += term
        if region[s, slot] != NOBODY:
            lanes[slot % LANES, 12] += region_share[region[s, slot]]
    _tree(lanes)
    particle.motion_end(s, lanes[0, 12], lanes[0], solid_velocity, matching, region_velocity, region_spin)


@cpu_kernel(ordered=True)
def region_motion(
    solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):  # fmt: skip
    """Velocity and spin of every region."""
    for s in prange(region_spin.shape[0]):
        _region_motion(
            s, solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity,
            region_spin,
        )  # fmt: skip


@formula
def _damp(
    s, solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place,
    matching, timestep, acceleration,
):  # fmt: skip
    """One node."""
    lanes = np.zeros((LANES, 3), acceleration.dtype)
    for slot in range(region.shape[1]):
        terms = particle.damp_slot(
            s, slot, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
        )
        for c, term in enumerate(terms):
            lanes[slot % LANES, c] += term
    _tree(lanes)
    particle.damp_end(s, lanes[0], region_count, place, matching, timestep, acceleration)


@cpu_kernel(ordered=True)
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    for s in prange(region_count.shape[0]):
        _damp(
            s, solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place,
            matching, timestep, acceleration,
        )  # fmt: skip
