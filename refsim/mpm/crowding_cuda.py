"""Density counted on the grid over that of the volume ratio, and its maximum, on a GPU.

A tree in shared memory, then one atomic maximum for each thread block.
"""

import math

import numpy as np

from refsim.backends import device
from refsim.backends.compile import THREADS_PER_BLOCK, cuda, cuda_kernel
from refsim.backends.primitives import largest_of_block
from refsim.mpm.crowding import particle_crowding


@cuda_kernel
def count_all(position, volume_ratio, node_mass, cell, background, counting, blocks, greatest_crowding, crowding):
    """Counted density over that of J for every particle, and the largest; a NaN counts as infinite."""
    i = cuda.grid(1)
    real = type(background.cell_size)
    own = real(0)
    if i < crowding.shape[0]:
        own = particle_crowding(i, position, volume_ratio, node_mass, cell, background, counting, blocks)
        crowding[i] = own
        if not own < real(math.inf):
            own = real(math.inf)
    # The maximum only grows: a value read too early costs a reduction of this block and nothing else.
    if cuda.syncthreads_or(np.int32(own > greatest_crowding[0])) == 0:
        return
    largest = largest_of_block(cuda.shared.array(THREADS_PER_BLOCK, crowding.dtype), own)
    if cuda.threadIdx.x == 0:
        cuda.atomic.max(greatest_crowding, 0, largest)


def count(position, volume_ratio, node_mass, background, counting, grid, greatest_crowding, crowding):
    """Counted density over that of J for every particle, and the largest; dimensionless."""
    device.fill(greatest_crowding, 0)
    count_all(
        position, volume_ratio, node_mass, grid.cells["particles"], background, counting, grid.blocks,
        greatest_crowding, crowding,
    )  # fmt: skip
