"""Shape matching with region sums by fast summation on a GPU.

Boxes pay for wide regions only: up to half-width NARROW the threads of a warp add up a region in less time than it
takes to pass over all cells axis by axis, and in the run's own precision.
"""

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
