"""Melting of all particles and their number: CUDA kernel.

One atomic addition for each block; a sum of whole numbers does not depend on the order of the blocks.
"""

from refsim.backends import device
from refsim.backends.compile import cuda, cuda_kernel
from refsim.melting.kernels import Heated, Molten, melted_now


def melt(heated: Heated, melting, melted, melted_count, molten: Molten):
    """Melt the particles at surfaces that are hot enough; `melted_count` is their number."""
    device.fill(melted_count, 0)
    melt_and_count(heated, melting, melted, melted_count, molten, molten.phase)


@cuda_kernel
def melt_and_count(heated, melting, melted, melted_count, molten, phase):
    """Melt the particles at surfaces that are hot enough; their number is added to `melted_count`, zero before."""
    i = cuda.grid(1)
    gone = False
    if i < phase.shape[0]:
        gone = melted_now(i, heated, melting, melted, molten)
    count = cuda.syncthreads_count(1 if gone else 0)
    if cuda.threadIdx.x == 0 and count > 0:
        cuda.atomic.add(melted_count, 0, count)
