"""CUDA kernels of shape matching with region sums by reduction: a block for each region, a tree in shared memory."""

from refsim.compile import THREADS_PER_BLOCK, cuda, cuda_kernel, formula
from refsim.shape_matching import particle
from refsim.shape_matching.phases import NOBODY

WIDEST = 16  # numbers that a region sums


@formula
def _tree(shared, count):
    """Add what the block's threads hold in the first `count` rows of `shared`; the sums stand in its first column."""
    t = cuda.threadIdx.x
    cuda.syncthreads()
    half = cuda.blockDim.x // 2
    while half > 0:
        if t < half:
            for c in range(count):
                shared[c, t] += shared[c, t + half]
        cuda.syncthreads()
        half //= 2


@cuda_kernel(block_for_each_row=True)
def match(solid_position, region_share, region, matching, region_center, region_anchor, rotation):
    """Center, rotation and anchor of every region."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    shared = cuda.shared.array((WIDEST, THREADS_PER_BLOCK), rotation.dtype)
    sums = particle.nothing_16(rotation.dtype.type(0))
    for slot in range(t, region.shape[1], cuda.blockDim.x):
        sums = particle.added(
            sums, particle.match_slot(s, slot, solid_position, region_share, region, matching.half_width)
        )
    for c, value in enumerate(sums):
        shared[c, t] = value
    _tree(shared, 16)
    if t == 0:
        matrix, basis = cuda.local.array((4, 4), rotation.dtype), cuda.local.array((4, 4), rotation.dtype)
        particle.match_end(s, shared[:, 0], matching, matrix, basis, region_center, region_anchor, rotation)


@cuda_kernel(block_for_each_row=True)
def pull(
    velocity, solid_position, region, region_count, region_anchor, rotation, place, matching, timestep, acceleration,
    solid_velocity,
):  # fmt: skip
    """Pull of every node towards its goal; added to the acceleration."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    shared = cuda.shared.array((3, THREADS_PER_BLOCK), rotation.dtype)
    zero = rotation.dtype.type(0)
    x, y, z = zero, zero, zero
    for slot in range(t, region.shape[1], cuda.blockDim.x):
        a, b, e = particle.goal_slot(s, slot, solid_position, region, region_anchor, rotation, matching)
        x += a
        y += b
        z += e
    shared[0, t], shared[1, t], shared[2, t] = x, y, z
    _tree(shared, 3)
    if t == 0:
        particle.goal_end(
            s, shared[:, 0], region_count, place, velocity, matching, timestep, acceleration, solid_velocity
        )


@cuda_kernel(block_for_each_row=True)
def region_motion(
    solid_position, solid_velocity, region_share, region, region_center, matching, region_velocity, region_spin
):  # fmt: skip
    """Velocity and spin of every region."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    shared = cuda.shared.array((13, THREADS_PER_BLOCK), region_spin.dtype)
    mass = region_spin.dtype.type(0)
    sums = particle.nothing_12(mass)
    for slot in range(t, region.shape[1], cuda.blockDim.x):
        if region[s, slot] != NOBODY:
            mass += region_share[region[s, slot]]
            sums = particle.added_12(
                sums, particle.motion_slot(s, slot, solid_position, solid_velocity, region_share, region, region_center)
            )
    for c, value in enumerate(sums):
        shared[c, t] = value
    shared[12, t] = mass
    _tree(shared, 13)
    if t == 0:
        particle.motion_end(s, shared[12, 0], shared[:, 0], solid_velocity, matching, region_velocity, region_spin)


@cuda_kernel(rows_of="region_count", block_for_each_row=True)
def damp(
    solid_position, solid_velocity, region, region_count, region_center, region_velocity, region_spin, place, matching,
    timestep, acceleration,
):  # fmt: skip
    """Damping of every node towards the rigid motion of its regions; added to the acceleration."""
    s, t = cuda.blockIdx.x, cuda.threadIdx.x
    shared = cuda.shared.array((3, THREADS_PER_BLOCK), acceleration.dtype)
    zero = acceleration.dtype.type(0)
    u, v, w = zero, zero, zero
    for slot in range(t, region.shape[1], cuda.blockDim.x):
        a, b, e = particle.damp_slot(
            s, slot, solid_position, solid_velocity, region, region_center, region_velocity, region_spin
        )
        u += a
        v += b
        w += e
    shared[0, t], shared[1, t], shared[2, t] = u, v, w
    _tree(shared, 3)
    if t == 0:
        particle.damp_end(s, shared[:, 0], region_count, place, matching, timestep, acceleration)
