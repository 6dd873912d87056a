"""The leap-frog step with the penetration correction, which yields the largest displacement: one parallel loop.

`reductions_cuda` has the CUDA kernel.
"""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.penetration.kernels import corrected_step


@cpu_kernel
def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, corrections,
    velocity, position,
):  # fmt: skip
    """Leap-frog step with patent P8; `displacement` is the largest squared displacement since the list was built [m^2]
    and the number of particles that a wall's plane stopped."""
    largest = displacement.dtype.type(0)
    stopped = 0
    for i in prange(position.shape[0]):
        squared, hit = corrected_step(
            i, position, velocity, acceleration, identity, corrections, build_position, bounds, timestep,
            solid_field, penetration,
        )  # fmt: skip
        largest = max(largest, squared)
        stopped += hit
    displacement[0] = largest
    displacement[1] = stopped
