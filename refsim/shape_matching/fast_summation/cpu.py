"""CPU kernels of shape matching with region sums by fast summation."""

import numpy as np

from refsim.compile import cpu_kernel, formula, prange
from refsim.shape_matching import particle as plain
from refsim.shape_matching.fast_summation import particle

STRETCH = 1024  # cells whose numbers stay in the cache while windows are summed


@cpu_kernel(ordered=True)
def _match_cells(solid_position, region_share, boxes, node):
    """Terms of every cell."""
    for cell in prange(node.shape[0]):
        particle.match_cell(cell, solid_position, region_share, boxes)


@cpu_kernel(ordered=True)
def _goal_cells(solid_position, region_count, region_anchor, rotation, boxes, matching, node):
    """Terms of every cell."""
    for cell in prange(node.shape[0]):
        particle.goal_cell(cell, solid_position, region_count, region_anchor, rotation, boxes, matching.spacing)


@cpu_kernel(ordered=True)
def _motion_cells(solid_position, solid_velocity, region_share, boxes, node):
    """Terms of every cell."""
    for cell in prange(node.shape[0]):
        particle.motion_cell(cell, solid_position, solid_velocity, region_share, boxes)


@cpu_kernel(ordered=True)
def _damp_cells(
    solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes, node
):  # fmt: skip
    """Terms of every cell."""
    for cell in prange(node.shape[0]):
        particle.damp_cell(
            cell, solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes
        )


@formula
def _along(axis, first_cell, end, half_width, side, source, target):
    """Sums of one number along an axis, a stretch of cells at a time: loops over cells vectorise."""
    stride = particle.stride_of(axis, side)
    for low in range(first_cell, end, STRETCH):
        high = min(low + STRETCH, end)
        for cell in range(low, high):
            target[cell] = source[cell]
        for k in range(1, half_width + 1):
            way = k * stride
            for cell in range(low, high):
                target[cell] += source[cell - way] + source[cell + way]


@cpu_kernel(ordered=True)
def _axis_sums(half_width, side, first, second):
    """Sums of every number over the box around every cell, axis after axis, into `second`."""
    margin = half_width * side[1] * side[2]
    for c in prange(first.shape[0]):
        end = first.shape[1] - margin
        _along(0, margin, end, half_width, side, first[c], second[c])
        _along(1, margin, end, half_width, side, second[c], first[c])
        _along(2, margin, end, half_width, side, first[c], second[c])


def _boxes(boxes, half_width, count):
    """Sums of the first `count` numbers over the box around every cell, into boxes.second."""
    _axis_sums(half_width, boxes.side, boxes.first[:count], boxes.second[:count])


@formula
def _match_node(
    s, solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
):  # fmt: skip
    """One node; its arrays are made here, because a parallel loop may not make them."""
    real = rotation.dtype.type
    moments = np.empty(16)
    found = particle.match_sums(s, solid_position, boxes, moments)
    sums = np.empty(16, rotation.dtype)
    if found == region_count[s] and found > 1:
        for c in range(16):
            sums[c] = real(moments[c])
    else:
        terms = plain.match_sums(s, solid_position, region_share, region, matching.half_width)
        for c, term in enumerate(terms):
            sums[c] = term
    matrix, basis = np.empty((4, 4), rotation.dtype), np.empty((4, 4), rotation.dtype)
    plain.match_end(s, sums, matching, matrix, basis, region_center, region_anchor, rotation)


@cpu_kernel(ordered=True)
def _match_nodes(
    solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(rotation.shape[0]):
        _match_node(
            s,
            solid_position,
            region_share,
            region,
            region_count,
            boxes,
            matching,
            region_center,
            region_anchor,
            rotation,
        )


@formula
def _goal_node(
    s, velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """One node; its arrays are made here, because a parallel loop may not make them."""
    real = solid_velocity.dtype.type
    ways = np.empty(3)
    sums = np.empty(3, solid_velocity.dtype)
    if particle.goal_sums(s, solid_position, boxes, matching.spacing, ways) == region_count[s]:
        for c in range(3):
            sums[c] = real(ways[c])
    else:
        sums[0], sums[1], sums[2] = plain.goal_sums(s, solid_position, region, region_anchor, rotation, matching)
    plain.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cpu_kernel(ordered=True)
def _goal_nodes(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(solid_velocity.shape[0]):
        _goal_node(
            s,
            velocity,
            solid_position,
            region,
            region_count,
            region_anchor,
            rotation,
            place,
            boxes,
            matching,
            timestep,
            acceleration,
            solid_velocity,
        )


@formula
def _motion_node(
    s, solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching,
    region_velocity, region_spin,
):  # fmt: skip
    """One node; its arrays are made here, because a parallel loop may not make them."""
    real = region_spin.dtype.type
    about = np.empty(13)
    found = particle.motion_sums(s, solid_position, solid_velocity, region_center, boxes, about)
    sums = np.empty(13, region_spin.dtype)
    if found == region_count[s] and found > 1:
        for c in range(13):
            sums[c] = real(about[c])
    else:
        mass, terms = plain.motion_sums(s, solid_position, solid_velocity, region_share, region, region_center)
        for c, term in enumerate(terms):
            sums[c] = term
        sums[12] = mass
    plain.motion_end(s, sums[12], sums, solid_velocity, matching, region_velocity, region_spin)


@cpu_kernel(ordered=True)
def _motion_nodes(
    solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching, region_velocity,
    region_spin,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(region_spin.shape[0]):
        _motion_node(
            s,
            solid_position,
            solid_velocity,
            region_share,
            region,
            region_count,
            region_center,
            boxes,
            matching,
            region_velocity,
            region_spin,
        )


@formula
def _damp_node(
    s, solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
    matching, timestep, acceleration,
):  # fmt: skip
    """One node; its arrays are made here, because a parallel loop may not make them."""
    real = acceleration.dtype.type
    ways = np.empty(3)
    sums = np.empty(3, acceleration.dtype)
    if particle.damp_sums(s, solid_position, solid_velocity, boxes, ways) == region_count[s]:
        for c in range(3):
            sums[c] = real(ways[c])
    else:
        sums[0], sums[1], sums[2] = plain.damp_sums(
            s, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
        )
    plain.damp_end(s, sums, region_count, place, matching, timestep, acceleration)


@cpu_kernel(ordered=True)
def _damp_nodes(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
    matching, timestep, acceleration,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(region_count.shape[0]):
        _damp_node(
            s,
            solid_position,
            solid_velocity,
            region,
            region_count,
            region_center,
            region_velocity,
            region_spin,
            place,
            boxes,
            matching,
            timestep,
            acceleration,
        )


def match(solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    _match_cells(solid_position, region_share, boxes, boxes.node)
    _boxes(boxes, matching.half_width, 17)
    _match_nodes(
        solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
    )


def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    _goal_cells(solid_position, region_count, region_anchor, rotation, boxes, matching, boxes.node)
    _boxes(boxes, matching.half_width, 13)
    _goal_nodes(
        velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
        acceleration, solid_velocity,
    )  # fmt: skip


def region_motion(
    solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching, region_velocity,
    region_spin,
):  # fmt: skip
    """Velocity and spin of every region."""
    _motion_cells(solid_position, solid_velocity, region_share, boxes, boxes.node)
    _boxes(boxes, matching.half_width, 17)
    _motion_nodes(
        solid_position,
        solid_velocity,
        region_share,
        region,
        region_count,
        region_center,
        boxes,
        matching,
        region_velocity,
        region_spin,
    )


def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
    matching, timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    _damp_cells(
        solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes, boxes.node
    )
    _boxes(boxes, matching.half_width, 7)
    _damp_nodes(
        solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
        matching, timestep, acceleration,
    )  # fmt: skip
