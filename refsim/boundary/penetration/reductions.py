"""The leap-frog step with the penetration correction, which yields the largest displacement, on a CPU.

`reductions_cuda` has the CUDA kernel.
"""

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import kernel
from refsim.boundary.penetration.kernels import Moving, corrected_step


def kick_drift(
    acceleration, identity, build_position, bounds, timestep, solid_field, penetration, displacement, moving: Moving
):
    """Leap-frog step with patent P8; `displacement` is the largest squared displacement since the list was built [m^2]
    and the number of particles that a wall's plane stopped."""
    partial = np.zeros((CHUNKS, len(displacement)), displacement.dtype)
    step_chunk(acceleration, identity, build_position, bounds, timestep, solid_field, penetration, moving, partial)
    displacement[:] = partial[:, 0].max(), partial[:, 1].sum()


@kernel
def step_chunk(
    chunk, acceleration, identity, build_position, bounds, timestep, solid_field, penetration, moving, partial
):
    """`kick_drift` of a chunk of the particles: its largest squared displacement [m^2] and number of stops."""
    largest = partial.dtype.type(0)
    begin, end = limits(chunk, moving.position.shape[0])
    stopped = 0
    for i in range(begin, end):
        squared, hit = corrected_step(
            i, acceleration, identity, build_position, bounds, timestep, solid_field, penetration, moving
        )
        largest = max(largest, squared)
        stopped += hit
    partial[chunk, 0], partial[chunk, 1] = largest, stopped
