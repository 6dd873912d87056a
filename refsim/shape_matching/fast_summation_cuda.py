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
    found = matching, region_center, region_anchor, rotation
    if matching.half_width <= NARROW:
        reduction.match(solid_position, region_share, region, *found)
    else:
        fast.match(solid_position, region_share, region, region_count, boxes, *found)


def pull(velocity, solid_position, goals: Goals, place, boxes, matching, timestep, acceleration, solid_velocity):
    """Pull of every node towards its goal; added to the acceleration."""
    moved = matching, timestep, acceleration, solid_velocity
    if matching.half_width <= NARROW:
        reduction.pull(velocity, solid_position, *goals, place, *moved)
    else:
        fast.pull(velocity, solid_position, goals, place, boxes, *moved)


def region_motion(solid_position, solid_velocity, members: Members, boxes, matching, region_velocity, region_spin):
    """Velocity and spin of every region."""
    found = matching, region_velocity, region_spin
    if matching.half_width <= NARROW:
        share, region, _, center = members
        reduction.region_motion(solid_position, solid_velocity, share, region, center, *found)
    else:
        fast.region_motion(solid_position, solid_velocity, members, boxes, *found)


def damp(solid_position, solid_velocity, motions: Motions, place, boxes, matching, timestep, acceleration):
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    if matching.half_width <= NARROW:
        reduction.damp(solid_position, solid_velocity, *motions, place, matching, timestep, acceleration)
    else:
        fast.damp(solid_position, solid_velocity, motions, place, boxes, matching, timestep, acceleration)


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


def sum_axes(half_width, boxes, count):
    """Sums of the first `count` numbers over the box around every cell, into boxes.second."""
    sum_axis(0, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
    sum_axis(1, half_width, count, boxes.side, boxes.second, boxes.first, boxes.node)
    sum_axis(2, half_width, count, boxes.side, boxes.first, boxes.second, boxes.node)
