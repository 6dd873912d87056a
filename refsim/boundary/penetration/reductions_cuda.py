"""The leap-frog step with the penetration correction, which yields the largest displacement: CUDA kernel.

A maximum in shared memory, then one atomic for each block; the results do not depend on the order of the blocks.
"""

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.boundary.penetration.kernels import Moving, corrected_step
from refsim.sph.reductions_cuda import reduce_step


def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, moving: Moving
):
    """Leap-frog step with patent P8; `displacement` is the largest squared displacement since the list was built [m^2]
    and the number of particles that a wall's plane stopped."""
    device.fill(displacement, 0)
    given = acceleration, identity, build_position, bounds, timestep, solid_field, penetration
    step_and_correct(*given, displacement, moving, moving.position)


@cuda_kernel
def step_and_correct(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, moving, position
):
    """Leap-frog step with patent P8; the largest displacement and the stops go into `displacement`, zero before."""
    i = cuda.grid(1)
    real = displacement.dtype.type
    squared, stopped = real(0), False
    if i < position.shape[0]:
        squared, stopped = corrected_step(
            i, acceleration, identity, build_position, bounds, timestep, solid_field, penetration, moving
        )
    reduce_step(squared, stopped, displacement)
