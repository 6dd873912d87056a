"""Reductions in CUDA kernels: sums and maxima over the threads of a block, and over threads that share a row."""

import numpy as np

from refsim.backends.compile import cuda, cuda_formula
from refsim.backends.runtime import simulated

MOST_THREADS = 1024  # of a block
WARP, WHOLE_WARP = 32, 0xFFFFFFFF


@cuda_formula
def largest_of_block(values, mine):  # noqa: ANN001, ANN201
    """Largest `mine` of the block's threads, a power of two of them; `values` is shared, one entry for each thread."""
    thread = cuda.threadIdx.x
    values[thread] = mine
    cuda.syncthreads()
    half = cuda.blockDim.x // 2
    while half > 0:
        if thread < half and values[thread + half] > values[thread]:
            values[thread] = values[thread + half]
        cuda.syncthreads()
        half //= 2
    return values[0]


@cuda_formula
def sum_of_block(values, mine):  # noqa: ANN001, ANN201
    """Sum of `mine` over the block's threads, a power of two of them; `values` is shared, one entry for each thread."""
    thread = cuda.threadIdx.x
    values[thread] = mine
    cuda.syncthreads()
    half = cuda.blockDim.x // 2
    while half > 0:
        if thread < half:
            values[thread] += values[thread + half]
        cuda.syncthreads()
        half //= 2
    return values[0]


if simulated():

    @cuda_formula
    def sum_before(values, mine):  # noqa: ANN001, ANN201  (types are Numba's)
        """Sum of `mine` over the block's threads before this one; `values` is shared, one entry for each thread."""
        thread = cuda.threadIdx.x
        values[thread] = mine
        cuda.syncthreads()
        step = 1
        while step < cuda.blockDim.x:
            add = values[thread - step] if thread >= step else 0
            cuda.syncthreads()
            values[thread] += add
            cuda.syncthreads()
            step *= 2
        return values[thread] - mine

    @cuda_formula
    def across_lanes(value, lane, lanes, step):  # noqa: ANN001, ANN201
        """What the thread holds whose lane differs by the bit `step`; all lanes of a row call it together."""
        held = cuda.shared.array(MOST_THREADS, object)  # values keep their types
        held[cuda.threadIdx.x] = value
        cuda.syncthreads()
        found = held[cuda.threadIdx.x ^ step]
        cuda.syncthreads()
        return found

else:

    @cuda_formula
    def sum_before(values, mine):  # noqa: ANN001, ANN201
        """Sum of `mine` over the block's threads before this one; `values` is shared, one entry for each thread.

        The block consists of whole warps.
        """
        lane, warp = cuda.laneid, cuda.threadIdx.x // WARP
        number = values.dtype.type
        total = number(mine)
        step = 1
        while step < WARP:
            other = cuda.shfl_up_sync(WHOLE_WARP, total, step)
            if lane >= step:
                total = number(total + other)
            step *= 2
        cuda.syncthreads()  # an earlier sum may still be read
        if lane == WARP - 1:
            values[warp] = total
        cuda.syncthreads()
        total = number(total - mine)
        for w in range(warp):
            total = number(total + values[w])
        return total

    @cuda_formula
    def across_lanes(value, lane, lanes, step):  # noqa: ANN001, ANN201
        """What the thread holds whose lane differs by the bit `step`; all lanes of a row call it together."""
        return cuda.shfl_xor_sync(lanes_mask(lane, lanes), value, step)


@cuda_formula
def lanes_mask(lane, lanes):  # noqa: ANN001, ANN201
    """Bits of a warp's threads that share a row with this one."""
    return np.uint32((1 << lanes) - 1) << np.uint32(cuda.laneid - lane)


@cuda_formula
def sum_of_lanes(value, lane, lanes):  # noqa: ANN001, ANN201
    """Sum of what so many neighbouring threads hold, a power of two, the same in all and always in the same order."""
    step = 1
    while step < lanes:
        value += across_lanes(value, lane, lanes, step)
        step *= 2
    return value


@cuda_formula
def counted_lanes(flag, lane, lanes):  # noqa: ANN001, ANN201
    """(how many lanes before this one raise their flag, how many of all)."""
    before, together = 0, 1 if flag else 0
    if lanes > 1:
        mask = lanes_mask(lane, lanes)
        raised = np.uint32(cuda.ballot_sync(mask, flag)) >> np.uint32(cuda.laneid - lane)
        raised &= np.uint32((1 << lanes) - 1)
        before = np.int64(cuda.popc(raised & np.uint32((1 << lane) - 1)))
        together = np.int64(cuda.popc(raised))
    return before, together
