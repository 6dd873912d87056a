"""CUDA kernels of lattice shape matching."""

import numpy as np

from refsim.backends.compile import cuda, cuda_kernel
from refsim.shape_matching import WIDEST, particle
from refsim.shape_matching.phases import NOBODY

MOST_SLOTS = (2 * WIDEST + 1) ** 3


@cuda_kernel
def direct_neighbours(phase, place, lattice, direct):
    """27 direct neighbours of every node, by binary search among the cells of its body."""
    s = cuda.grid(1)
    if s < direct.shape[0]:
        particle.direct_neighbours(s, phase, place, lattice, direct)


@cuda_kernel(block_for_each_row=True)
def regions(direct, rebuild, lattice, region, region_count):
    """Regions by filling level by level; all of them, or those marked in `rebuild`. A block shares a region."""
    s = cuda.blockIdx.x
    entries = cuda.shared.array(MOST_SLOTS, np.int32)
    wanted = True
    if rebuild is not None:
        wanted = rebuild[s] != 0
    if wanted:
        slots, own, step = region.shape[1], cuda.threadIdx.x, cuda.blockDim.x
        side = 1
        while side * side * side < slots:
            side += 2
        for slot in range(own, slots, step):
            entries[slot] = particle.next_to(s, slot, direct, side)
        if own == 0:
            region_count[s] = 0
        cuda.syncthreads()
        for level in range(2, side // 2 + 1):
            for slot in range(own, slots, step):
                if entries[slot] == NOBODY:
                    other = particle.reached(slot, level, direct, entries, side)
                    if other != NOBODY:
                        entries[slot] = other | (level << particle.LEVEL)
            cuda.syncthreads()
        count = 0
        for slot in range(own, slots, step):
            entry = entries[slot]
            if entry != NOBODY:
                entry &= particle.NUMBER
                count += 1
            region[s, slot] = entry
        cuda.atomic.add(region_count, s, count)


@cuda_kernel
def classify(identity, direct, phase):
    """Surface and inside of solids."""
    i = cuda.grid(1)
    if i < phase.shape[0] and identity[i] < direct.shape[0]:
        phase[i] = particle.phase_of(identity[i], direct)


@cuda_kernel
def gather(position, mass, place, region_count, region_share, solid_position):
    """Positions and shares of the nodes, in the particles' first order."""
    s = cuda.grid(1)
    if s < solid_position.shape[0]:
        particle.gather(s, position, mass, place, region_count, region_share, solid_position)


@cuda_kernel
def match(solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    s = cuda.grid(1)
    if s < rotation.shape[0]:
        matrix, basis = cuda.local.array((4, 4), np.float64), cuda.local.array((4, 4), np.float64)
        sums = particle.match_sums(s, solid_position, region_share, region, matching.half_width)
        particle.match_end(
            s, sums, solid_position, region_share, region, matching, matrix, basis, region_center, region_anchor,
            rotation,
        )  # fmt: skip


@cuda_kernel
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    s = cuda.grid(1)
    if s < solid_velocity.shape[0]:
        sums = particle.goal_sums(s, solid_position, region, region_anchor, rotation, matching)
        particle.goal_end(s, sums, region_count, place, velocity, matching, timestep, acceleration, solid_velocity)


@cuda_kernel
def region_motion(
    solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):
    """Velocity and spin of every region."""
    s = cuda.grid(1)
    if s < region_spin.shape[0]:
        mass, sums = particle.motion_sums(s, solid_position, solid_velocity, region_share, region, region_center)
        particle.motion_end(s, mass, sums, solid_velocity, matching, region_velocity, region_spin)


@cuda_kernel(rows_of="region_count")
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    s = cuda.grid(1)
    if s < region_count.shape[0]:
        sums = particle.damp_sums(
            s, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
        )
        particle.damp_end(s, sums, region_count, place, matching, timestep, acceleration)
