"""CPU kernel of the penetration correction."""

from refsim.backends.compile import cpu_kernel, prange
from refsim.boundary.penetration import particle


@cpu_kernel
def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, corrections,
    velocity, position,
):  # fmt: skip
    """Leap-frog step with P8; `displacement` as `sph.kick_drift` writes it."""
    largest = displacement.dtype.type(0)
    stopped = 0
    for i in prange(position.shape[0]):
        squared, hit = particle.kick_drift(
            i, position, velocity, acceleration, identity, corrections, build_position, bounds, timestep,
            solid_field, penetration,
        )  # fmt: skip
        largest = max(largest, squared)
        stopped += hit
    displacement[0] = largest
    displacement[1] = stopped
