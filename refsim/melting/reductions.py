"""Melting of all particles and their number on a CPU; `reductions_cuda` has the CUDA kernel."""

import numpy as np

from refsim.backends.chunks import CHUNKS, limits
from refsim.backends.compile import kernel
from refsim.melting.kernels import Heated, Molten, melted_now


def melt(heated: Heated, melting, melted, melted_count, molten: Molten):
    """Melt the particles at surfaces that are hot enough; `melted_count` is their number."""
    partial = np.zeros(CHUNKS, np.int32)
    melt_chunk(heated, melting, melted, molten, partial)
    melted_count[0] = partial.sum()


@kernel
def melt_chunk(chunk, heated, melting, melted, molten, partial):
    """Melt the particles of a chunk; their number."""
    begin, end = limits(chunk, molten.phase.shape[0])
    count = 0
    for i in range(begin, end):
        count += melted_now(i, heated, melting, melted, molten)
    partial[chunk] = count
