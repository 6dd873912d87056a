"""CPU kernels of shape matching with region sums by fast summation."""

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, prange
from refsim.shape_matching import particle as plain
from refsim.shape_matching.fast_summation import particle


@cpu_kernel(ordered=True)
def _match_cells(solid_position, region_share, boxes):
    """Terms of every node's cell."""
    for s in prange(boxes.cell.shape[0]):
        particle.match_cell(boxes.cell[s], solid_position, region_share, boxes)


@cpu_kernel(ordered=True)
def _goal_cells(solid_position, region_count, region_anchor, rotation, boxes, matching):
    """Terms of every node's cell."""
    for s in prange(boxes.cell.shape[0]):
        particle.goal_cell(
            boxes.cell[s], solid_position, region_count, region_anchor, rotation, boxes, matching.spacing
        )


@cpu_kernel(ordered=True)
def _motion_cells(solid_position, solid_velocity, region_share, boxes):
    """Terms of every node's cell."""
    for s in prange(boxes.cell.shape[0]):
        particle.motion_cell(boxes.cell[s], solid_position, solid_velocity, region_share, boxes)


@cpu_kernel(ordered=True)
def _damp_cells(
    solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes
):  # fmt: skip
    """Terms of every node's cell."""
    for s in prange(boxes.cell.shape[0]):
        particle.damp_cell(
            boxes.cell[s],
            solid_position,
            solid_velocity,
            region_count,
            region_center,
            region_velocity,
            region_spin,
            boxes,
        )


@formula
def _box_sums(source, target, half_width, boxes):
    """Sums of one number over the box around every node: along rows and across them in each plane, then over planes.

    Only where there are nodes to sum for, and a few planes at a time, which stay in the cache.
    """
    planes, columns = boxes.planes, boxes.side[2]
    area, window = boxes.side[1] * columns, 2 * half_width + 1
    lines, sums = np.zeros(area), np.zeros((window, area))
    for p in range(planes.shape[0]):
        low, high = planes[p, 6], planes[p, 7]
        for row in range(planes[p, 2], planes[p, 3]):
            at = row * columns
            there = p * area + at
            for c in range(low, high):
                lines[at + c] = source[there + c]
            for k in range(1, half_width + 1):
                for c in range(low, high):
                    lines[at + c] += source[there + c - k] + source[there + c + k]
        plane = sums[p % window]
        for row in range(planes[p, 4], planes[p, 5]):
            at = row * columns
            for c in range(low, high):
                plane[at + c] = 0.0
            for near in range(max(row - half_width, planes[p, 2]), min(row + half_width + 1, planes[p, 3])):
                beside = near * columns
                for c in range(low, high):
                    plane[at + c] += lines[beside + c]
        middle = p - half_width
        if middle >= 0:
            for s in range(planes[middle, 0], planes[middle, 1]):
                total = 0.0
                for k in range(window):
                    total += sums[k, boxes.cell[s] - middle * area]
                target[boxes.cell[s]] = total


@cpu_kernel(ordered=True)
def _sum_boxes(half_width, count, boxes):
    """Sums of the first `count` numbers over the box around every node, into boxes.second."""
    for c in prange(count):
        _box_sums(boxes.first[c], boxes.second[c], half_width, boxes)


@formula
def _match_node(
    s, solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
):  # fmt: skip
    """One node; its arrays are made here, because a parallel loop may not make them, and only where they are used."""
    found, sums = particle.match_sums(s, solid_position, boxes)
    if found != region_count[s] or found <= 1:
        sums = plain.match_sums(s, solid_position, region_share, region, matching.half_width)
    near, q = plain.match_quick(s, sums, solid_position, matching, rotation)
    if near:
        plain.match_write(s, sums, q, matching, region_center, region_anchor, rotation)
    else:
        matrix, basis = np.empty((4, 4), np.float64), np.empty((4, 4), np.float64)
        plain.match_end(
            s, sums, solid_position, region_share, region, matching, matrix, basis, region_center, region_anchor,
            rotation,
        )  # fmt: skip


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


@cpu_kernel(ordered=True)
def _goal_nodes(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(solid_velocity.shape[0]):
        found, sums = particle.goal_sums(s, solid_position, boxes, matching.spacing)
        if found != region_count[s]:
            sums = plain.goal_sums(s, solid_position, region, region_anchor, rotation, matching)
        plain.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cpu_kernel(ordered=True)
def _motion_nodes(
    solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching, region_velocity,
    region_spin,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(region_spin.shape[0]):
        found, mass, sums = particle.motion_sums(s, solid_position, solid_velocity, region_center, boxes)
        if found != region_count[s] or found <= 1 or particle.too_small(mass, sums, matching):
            mass, sums = plain.motion_sums(s, solid_position, solid_velocity, region_share, region, region_center)
        plain.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@cpu_kernel(ordered=True)
def _damp_nodes(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
    matching, timestep, acceleration,
):  # fmt: skip
    """Every node, from the sums of its box or, where its region is not the whole box, member by member."""
    for s in prange(region_count.shape[0]):
        found, sums = particle.damp_sums(s, solid_position, solid_velocity, boxes)
        if found != region_count[s]:
            sums = plain.damp_sums(
                s, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
            )
        plain.damp_end(s, sums, region_count, place, matching, timestep, acceleration)


def match(solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    _match_cells(solid_position, region_share, boxes)
    _sum_boxes(matching.half_width, 17, boxes)
    _match_nodes(
        solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
    )


def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
    acceleration, solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    _goal_cells(solid_position, region_count, region_anchor, rotation, boxes, matching)
    _sum_boxes(matching.half_width, 13, boxes)
    _goal_nodes(
        velocity, solid_position, region, region_count, region_anchor, rotation, place, boxes, matching, timestep,
        acceleration, solid_velocity,
    )  # fmt: skip


def region_motion(
    solid_position, solid_velocity, region_share, region, region_count, region_center, boxes, matching, region_velocity,
    region_spin,
):  # fmt: skip
    """Velocity and spin of every region."""
    _motion_cells(solid_position, solid_velocity, region_share, boxes)
    _sum_boxes(matching.half_width, 17, boxes)
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
    _damp_cells(solid_position, solid_velocity, region_count, region_center, region_velocity, region_spin, boxes)
    _sum_boxes(matching.half_width, 7, boxes)
    _damp_nodes(
        solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, boxes,
        matching, timestep, acceleration,
    )  # fmt: skip
