"""CUDA kernel of the penetration correction."""

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel
from refsim.backends.primitives import largest_of_block
from refsim.boundary.penetration import particle


def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, corrections,
    velocity, position,
):  # fmt: skip
    """Leap-frog step with P8; `displacement` as `sph.kick_drift` writes it."""
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
    """Leap-frog step with P8 of every particle, the largest squared way and the number of stopped particles."""
    i = cuda.grid(1)
    real = displacement.dtype.type
    squared, stopped = real(0), False
    if i < position.shape[0]:
        squared, stopped = particle.kick_drift(
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
