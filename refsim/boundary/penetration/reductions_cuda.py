"""The leap-frog step with the penetration correction, which yields the largest displacement: CUDA kernel.

A maximum in shared memory, then one atomic for each block; the results do not depend on the order of the blocks.
"""

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel
from refsim.backends.primitives import largest_of_block
from refsim.boundary.penetration.kernels import corrected_step


def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, corrections,
    velocity, position,
):  # fmt: skip
    """Leap-frog step with patent P8; `displacement` is the largest squared displacement since the list was built [m^2]
    and the number of particles that a wall's plane stopped."""
    device.fill(displacement, 0)
    step_and_correct(
        acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement,
        corrections, velocity, position,
    )  # fmt: skip


@cuda_kernel
def step_and_correct(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, corrections,
    velocity, position,
):  # fmt: skip
    """Leap-frog step with patent P8; the largest displacement and the stops go into `displacement`, zero before."""
    i = cuda.grid(1)
    real = displacement.dtype.type
    squared, stopped = real(0), False
    if i < position.shape[0]:
        squared, stopped = corrected_step(
            i, position, velocity, acceleration, identity, corrections, build_position, bounds, timestep,
            solid_field, penetration,
        )  # fmt: skip
    shared = cuda.shared.array(THREADS_PER_BLOCK, displacement.dtype)
    largest = largest_of_block(shared, squared)
    stops = cuda.syncthreads_count(1 if stopped else 0)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(displacement, 0, largest)
        if stops > 0:
            cuda.atomic.add(displacement, 1, real(stops))
