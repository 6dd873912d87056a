"""CPU kernels of lattice shape matching."""

import numpy as np

from refsim.backends.compile import cpu_kernel, formula, prange
from refsim.shape_matching import particle


@cpu_kernel(ordered=True)
def direct_neighbours(phase, place, lattice, direct):
    """27 direct neighbours of every node, by binary search among the cells of its body."""
    for s in prange(direct.shape[0]):
        particle.direct_neighbours(s, phase, place, lattice, direct)


@cpu_kernel(ordered=True)
def regions(direct, rebuild, lattice, region, region_count):
    """Regions by filling level by level; all of them, or those marked in `rebuild`."""
    for s in prange(region_count.shape[0]):
        wanted = True
        if rebuild is not None:
            wanted = rebuild[s] != 0
        if wanted:
            region_count[s] = particle.fill_region(s, direct, region)


@cpu_kernel(ordered=True)
def classify(identity, direct, phase):
    """Surface and inside of solids."""
    for i in prange(phase.shape[0]):
        if identity[i] < direct.shape[0]:
            phase[i] = particle.phase_of(identity[i], direct)


@cpu_kernel(ordered=True)
def gather(position, mass, place, region_count, region_share, solid_position):
    """Positions and shares of the nodes, in the particles' first order."""
    for s in prange(solid_position.shape[0]):
        particle.gather(s, position, mass, place, region_count, region_share, solid_position)


@formula
def _match(s, solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """One region; its arrays are made here, because a parallel loop may not make them."""
    matrix, basis = np.empty((4, 4), np.float64), np.empty((4, 4), np.float64)
    sums = particle.match_sums(s, solid_position, region_share, region, matching.half_width)
    particle.match_end(
        s, sums, solid_position, region_share, region, matching, matrix, basis, region_center, region_anchor, rotation
    )


@cpu_kernel(ordered=True)
def match(solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    for s in prange(rotation.shape[0]):
        _match(s, solid_position, region_share, region, matching, region_center, region_anchor, rotation)


@cpu_kernel(ordered=True)
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    for s in prange(solid_velocity.shape[0]):
        sums = particle.goal_sums(s, solid_position, region, region_anchor, rotation, matching)
        particle.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cpu_kernel(ordered=True)
def region_motion(
    solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):
    """Velocity and spin of every region."""
    for s in prange(region_spin.shape[0]):
        mass, sums = particle.motion_sums(s, solid_position, solid_velocity, region_share, region, region_center)
        particle.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@cpu_kernel(ordered=True)
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    for s in prange(region_count.shape[0]):
        sums = particle.damp_sums(
            s, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
        )
        particle.damp_end(s, sums, region_count, place, matching, timestep, acceleration)
