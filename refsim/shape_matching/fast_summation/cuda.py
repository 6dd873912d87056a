"""CUDA kernels of shape matching with region sums by fast summation.

Boxes pay for wide regions only: up to NARROW the threads of a warp add up a region in less time than it takes to pass
over all cells axis by axis, and in the run's own precision.
"""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel
from refsim.shape_matching import particle as plain
from refsim.shape_matching.fast_summation import particle
from refsim.shape_matching.parallel_reduction import cuda as reduction

NARROW = 2  # half-width up to which regions are summed by reduction


@cuda_kernel
def _match_cells(solid_position, region_share, boxes, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        particle.match_cell(cell, solid_position, region_share, boxes)


@cuda_kernel
def _goal_cells(solid_position, region_count, region_anchor, rotation, boxes, matching, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        particle.goal_cell(cell, solid_position, region_count, region_anchor, rotation, boxes, matching.spacing)


@cuda_kernel
def _motion_cells(solid_position, solid_velocity, region_share, boxes, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        particle.motion_cell(cell, solid_position, solid_velocity, region_share, boxes)


@cuda_kernel
def _damp_cells(
    solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes, node
):  # fmt: skip
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        particle.damp_cell(
            cell, solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes
        )


@cuda_kernel
def _axis_sums(axis, half_width, count, side, source, target, node):
    """Sums along one axis around every cell; what threads read together lies together."""
    cell = cuda.grid(1)
    margin = half_width * side[1] * side[2]
    if margin <= cell < node.shape[0] - margin:
        stride = particle.stride_of(axis, side)
        for c in range(count):
            particle.axis_sum(c, cell, stride, half_width, source, target)


def _boxes(boxes, half_width, count):
    """Sums of the first `count` numbers over the box around every cell, into boxes.second."""
    _axis_sums(0, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
    _axis_sums(1, half_width, count, boxes.side, boxes.second, boxes.first, boxes.node)
    _axis_sums(2, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)


@cuda_kernel
def _match_nodes(
    solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    s = cuda.grid(1)
    if s < rotation.shape[0]:
        found, sums = particle.match_sums(s, solid_position, boxes)
        if found != region_count[s] or found <= 1:
            sums = plain.match_sums(s, solid_position, region_share, region, matching.half_width)
        matrix, basis = cuda.local.array((4, 4), np.float64), cuda.local.array((4, 4), np.float64)
        plain.match_end(
            s, sums, solid_position, region_share, region, matching, matrix, basis, region_center, region_anchor,
            rotation,
        )  # fmt: skip


@cuda_kernel
def _goal_nodes(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    s = cuda.grid(1)
    if s < solid_velocity.shape[0]:
        found, sums = particle.goal_sums(s, solid_position, boxes, matching.spacing)
        if found != region_count[s]:
            sums = plain.goal_sums(s, solid_position, region, region_anchor, rotation, matching)
        plain.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cuda_kernel
def _motion_nodes(
    solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching, region_velocity,
    region_spin,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    s = cuda.grid(1)
    if s < region_spin.shape[0]:
        found, mass, sums = particle.motion_sums(s, solid_position, solid_velocity, region_center, boxes)
        if found != region_count[s] or found <= 1 or particle.too_small(mass, sums, matching):
            mass, sums = plain.motion_sums(s, solid_position, solid_velocity, region_share, region, region_center)
        plain.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@cuda_kernel(rows_of="region_count")
def _damp_nodes(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
    matching, timestep, acceleration,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    s = cuda.grid(1)
    if s < region_count.shape[0]:
        found, sums = particle.damp_sums(s, solid_position, solid_velocity, boxes)
        if found != region_count[s]:
            sums = plain.damp_sums(
                s, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
            )
        plain.damp_end(s, sums, region_count, place, matching, timestep, acceleration)


def match(solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    if matching.half_width <= NARROW:
        reduction.match(solid_position, region_share, region, matching, region_center, region_anchor, rotation)
        return
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
    if matching.half_width <= NARROW:
        reduction.pull(
            velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep,
            acceleration, solid_velocity,
        )  # fmt: skip
        return
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
    if matching.half_width <= NARROW:
        reduction.region_motion(
            solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
        )
        return
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
    if matching.half_width <= NARROW:
        reduction.damp(
            solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place,
            matching, timestep, acceleration,
        )  # fmt: skip
        return
    _damp_cells(
        solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes, boxes.node
    )
    _boxes(boxes, matching.half_width, 7)
    _damp_nodes(
        solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
        matching, timestep, acceleration,
    )  # fmt: skip
