"""CUDA kernels of shape matching with region sums by fast summation.

Boxes pay for wide regions only: up to half-width NARROW the threads of a warp add up a region in less time than it
takes to pass over all cells axis by axis, and in the run's own precision.
"""

from refsim.backends.compile import cuda, cuda_kernel, formula
from refsim.shape_matching import fast_summation as fast
from refsim.shape_matching import parallel_reduction_cuda as reduction
from refsim.shape_matching.fast_summation import Goals, Members, Motions

NARROW = 2  # half-width up to which regions are summed by reduction


def match(solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    if matching.half_width <= NARROW:
        reduction.match(solid_position, region_share, region, matching, region_center, region_anchor, rotation)
        return
    match_cells(solid_position, region_share, boxes, boxes.node)
    sum_boxes(boxes, matching.half_width, 17)
    fast.match_nodes(
        solid_position, region_share, region, region_count, boxes, matching, region_center, region_anchor, rotation
    )


def pull(velocity, solid_position, goals: Goals, place, boxes, matching, timestep, acceleration, solid_velocity):
    """Pull of every node towards its goal; added to the acceleration."""
    if matching.half_width <= NARROW:
        reduction.pull(velocity, solid_position, *goals, place, matching, timestep, acceleration, solid_velocity)
        return
    goal_cells(solid_position, goals, boxes, matching, boxes.node)
    sum_boxes(boxes, matching.half_width, 13)
    fast.goal_nodes(velocity, solid_position, goals, place, boxes, matching, timestep, acceleration, solid_velocity)


def region_motion(solid_position, solid_velocity, members: Members, boxes, matching, region_velocity, region_spin):
    """Velocity and spin of every region."""
    if matching.half_width <= NARROW:
        share, region, _, center = members
        reduction.region_motion(
            solid_position, solid_velocity, share, region, center, matching, region_velocity, region_spin
        )
        return
    motion_cells(solid_position, solid_velocity, members.region_share, boxes, boxes.node)
    sum_boxes(boxes, matching.half_width, 17)
    fast.motion_nodes(solid_position, solid_velocity, members, boxes, matching, region_velocity, region_spin)


def damp(solid_position, solid_velocity, motions: Motions, place, boxes, matching, timestep, acceleration):
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    if matching.half_width <= NARROW:
        reduction.damp(solid_position, solid_velocity, *motions, place, matching, timestep, acceleration)
        return
    damp_cells(solid_position, solid_velocity, motions, boxes, boxes.node)
    sum_boxes(boxes, matching.half_width, 7)
    count = motions.region_count
    fast.damp_nodes(solid_position, solid_velocity, count, motions, place, boxes, matching, timestep, acceleration)


@cuda_kernel
def match_cells(solid_position, region_share, boxes, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        fast.match_cell(cell, solid_position, region_share, boxes)


@cuda_kernel
def goal_cells(solid_position, goals, boxes, matching, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        fast.goal_cell(cell, solid_position, goals, boxes, matching.spacing)


@cuda_kernel
def motion_cells(solid_position, solid_velocity, region_share, boxes, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        fast.motion_cell(cell, solid_position, solid_velocity, region_share, boxes)


@cuda_kernel
def damp_cells(solid_position, solid_velocity, motions, boxes, node):
    """Terms of every cell."""
    cell = cuda.grid(1)
    if cell < node.shape[0]:
        fast.damp_cell(cell, solid_position, solid_velocity, motions, boxes)


@formula
def stride_of(axis, side):
    """Distance of neighbouring cells along an axis in memory [cells]."""
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


@cuda_kernel
def sum_axis(axis, half_width, count, side, source, target, node):
    """Sums along one axis around every cell; neighbouring threads read contiguous memory."""
    cell = cuda.grid(1)
    margin = half_width * side[1] * side[2]
    if margin <= cell < node.shape[0] - margin:
        stride = stride_of(axis, side)
        for c in range(count):
            axis_sum(c, cell, stride, half_width, source, target)


def sum_boxes(boxes, half_width, count):
    """Sums of the first `count` numbers over the box around every cell, into boxes.second."""
    sum_axis(0, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
    sum_axis(1, half_width, count, boxes.side, boxes.second, boxes.first, boxes.node)
    sum_axis(2, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
