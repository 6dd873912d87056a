"""Reductions in CUDA kernels: sums and maxima over the threads of a block, and over threads that share a row."""

import numpy as np

from refsim.backends.compile import begins_early, cuda, cuda_formula
from refsim.backends.runtime import simulated

MOST_THREADS = 1024  # of a block
WARP, WHOLE_WARP = 32, 0xFFFFFFFF


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
    def largest_of_block(values, mine):  # noqa: ANN001, ANN201
        """Largest `mine` of the block's threads, a power of two; `values` is shared, one entry for each thread."""
        values[cuda.threadIdx.x] = mine
        cuda.syncthreads()
        largest = values[: cuda.blockDim.x].max()
        cuda.syncthreads()
        return largest

    @cuda_formula
    def sum_before(values, mine):  # noqa: ANN001, ANN201  (types are Numba's)
        """Sum of `mine` over the block's threads before this one; `values` is shared, one entry for each thread."""
        values[cuda.threadIdx.x] = mine
        cuda.syncthreads()
        before = values[: cuda.threadIdx.x].sum(dtype=values.dtype)
        cuda.syncthreads()
        return before

    @cuda_formula
    def across_lanes(value, lane, lanes, step):  # noqa: ANN001, ANN201
        """What the thread holds whose lane differs by the bit `step`; all lanes of a row call it together."""
        held = cuda.shared.array(MOST_THREADS, object)  # values keep their types
        held[cuda.threadIdx.x] = value
        cuda.syncthreads()
        found = held[cuda.threadIdx.x ^ step]
        cuda.syncthreads()
        return found

    @cuda_formula
    def count_up(counters, k):  # noqa: ANN001, ANN201
        """counters[k] before this thread has added one to it."""
        return cuda.atomic.add(counters, k, 1)

    @cuda_formula
    def four_of(array, i):  # noqa: ANN001, ANN201
        """The numbers of row i of an (n, 4) array."""
        return array[i, 0], array[i, 1], array[i, 2], array[i, 3]

    @cuda_formula
    def set_four(array, i, x, y, z, w):  # noqa: ANN001, ANN201
        """Row i of an (n, 4) array becomes these numbers."""
        array[i, 0], array[i, 1], array[i, 2], array[i, 3] = x, y, z, w

    @cuda_formula
    def wait_for_last():  # noqa: ANN201
        """Wait for the kernel launched before: here each has ended."""

else:
    from llvmlite import ir
    from numba.core import types
    from numba.cuda.extending import intrinsic

    @cuda_formula
    def largest_of_block(values, mine):  # noqa: ANN001, ANN201
        """Largest `mine` of the block's threads, whole warps; `values` is shared, one entry for each thread."""
        largest = mine
        step = WARP // 2
        while step > 0:
            other = cuda.shfl_xor_sync(WHOLE_WARP, largest, step)
            if other > largest:
                largest = other
            step //= 2
        cuda.syncthreads()  # an earlier result may still be read
        if cuda.laneid == 0:
            values[cuda.threadIdx.x // WARP] = largest
        cuda.syncthreads()
        largest = values[0]
        for w in range(1, cuda.blockDim.x // WARP):
            if values[w] > largest:
                largest = values[w]
        return largest

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
    def count_up(counters, k):  # noqa: ANN001, ANN201
        """counters[k] before this thread has added one to it; threads of a warp with the same k add once together."""
        same = cuda.match_any_sync(cuda.activemask(), np.int32(k))
        first = cuda.ffs(same) - 1
        before = np.int32(0)
        if cuda.laneid == first:
            before = np.int32(cuda.atomic.add(counters, k, np.int32(cuda.popc(same))))
        return cuda.shfl_sync(same, before, first) + np.int32(cuda.popc(same & cuda.lanemask_lt()))

    @intrinsic
    def four_of(typing_context, array, i):  # noqa: ANN001, ANN201
        """The numbers of row i of an (n, 4) array, in one read of 16 bytes (float64: in two)."""
        signature = types.UniTuple(array.dtype, 4)(array, i)

        def generate(context, builder, signature, values):  # noqa: ANN001, ANN202
            read = builder.load(_row(context, builder, signature, values), align=16)
            parts = [builder.extract_element(read, ir.Constant(ir.IntType(32), k)) for k in range(4)]
            return context.make_tuple(builder, signature.return_type, parts)

        return signature, generate

    @intrinsic
    def set_four(typing_context, array, i, x, y, z, w):  # noqa: ANN001, ANN201
        """Row i of an (n, 4) array becomes these numbers, in one write of 16 bytes (float64: in two)."""
        real = array.dtype
        signature = types.void(array, i, real, real, real, real)

        def generate(context, builder, signature, values):  # noqa: ANN001, ANN202
            row = _row(context, builder, signature, values)
            written = ir.Constant(row.type.pointee, ir.Undefined)
            for k, value in enumerate(values[2:]):
                written = builder.insert_element(written, value, ir.Constant(ir.IntType(32), k))
            builder.store(written, row, align=16)
            return context.get_dummy_value()

        return signature, generate

    def _row(context, builder, signature, values):  # noqa: ANN001, ANN202
        """Address of row values[1] of the array values[0], as a vector of four."""
        kind, index = signature.args[:2]
        four = ir.VectorType(context.get_data_type(kind.dtype), 4)
        rows = builder.bitcast(context.make_array(kind)(context, builder, values[0]).data, four.as_pointer())
        return builder.gep(rows, [context.cast(builder, values[1], index, types.intp)])

    @intrinsic
    def wait_for_last(typing_context):  # noqa: ANN001, ANN201
        """Wait until the kernel launched before an `early` one has ended, and let the next early one begin."""

        def generate(context, builder, signature, values):  # noqa: ANN001, ANN202
            if begins_early():
                text = "griddepcontrol.wait; griddepcontrol.launch_dependents;"
                none = ir.FunctionType(ir.VoidType(), [])
                builder.call(ir.InlineAsm(none, text, "~{memory}", side_effect=True), [])
            return context.get_dummy_value()

        return types.void(), generate


@cuda_formula
def behind_last(works):  # noqa: ANN001, ANN201
    """`works`, for which a thread has waited for the kernel launched before, as the first block always does."""
    if works or cuda.blockIdx.x == 0:
        wait_for_last()
    return works


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
def sum_before_lane(value, lane, lanes):  # noqa: ANN001, ANN201
    """(sum of the int32 `value` over the lanes before this one, sum over all), int32."""
    before, together = np.int32(0), np.int32(value)
    step = 1
    while step < lanes:  # `together` is the sum over a group of `step` lanes
        other = np.int32(across_lanes(together, lane, lanes, step))
        if lane & step != 0:
            before = np.int32(before + other)
        together = np.int32(together + other)
        step *= 2
    return before, together


@cuda_formula
def wait_for_all(arrived, at, times):  # noqa: ANN001, ANN201
    """Wait until all thread blocks of a resident kernel have been here so many times, counted in arrived[at] from 0.

    What they wrote before is then read behind this.
    """
    cuda.threadfence()
    cuda.syncthreads()
    if cuda.threadIdx.x == 0:
        cuda.atomic.add(arrived, at, 1)
        while cuda.atomic.add(arrived, at, 0) < times * cuda.gridDim.x:
            pass
        cuda.threadfence()
    cuda.syncthreads()
