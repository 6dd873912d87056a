"""The loop over rows of a CPU kernel, shared by Numba's threads: `over_rows`.

Numba's own parallel loops (`prange`) compile a body twice, as Python and as machine code, and rewrite it for arrays
before; here the body is compiled once. A thread takes a part of the rows whenever it has done one, because rows at a
surface take longer than others, and each row is computed by one call of the body, so that the result does not depend
on which thread that was.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

from refsim.backends.fast.private import names

_private = names("fast")
cgutils: Any = _private and _private.cgutils
PARTS = 16  # of the rows, for each thread
LOOP = {
    "noinline",  # one piece of machine code for one thread and for many
    '"prefer-vector-width"="256"',  # 8 float32: 20 neighbours, as in 2D, are 24 places then, 32 with 512 bits
}


def over_rows(body: Any, rows: int, arguments: tuple) -> None:
    """body(i, *arguments) for each i below `rows`, in parts that Numba's threads share; for compiled code.

    The arrays among the arguments must not overlap, unless none of them is written.
    """
    for i in range(rows):
        body(i, *arguments)


over_rows.written = "loop"  # type: ignore[attr-defined]


def _typed(context: Any) -> Any:
    def result(body: types.Type, rows: types.Type, arguments: types.Type) -> types.Type:
        context.resolve_function_type(body, (types.intp, *arguments.types), {})  # raises the body's own typing errors
        return types.none

    return result


def _lowered(context: Any, builder: ir.IRBuilder, signature: Any, values: tuple) -> Any:
    body, count_type, tuple_type = signature.args
    rows = context.cast(builder, values[1], count_type, types.intp)
    loop = _loop(context, builder.module, body, tuple_type.types)
    part = _part(context, builder.module, loop, tuple_type)
    byte, word = cgutils.voidptr_t, cgutils.intp_t
    threads = builder.call(
        cgutils.get_or_insert_function(builder.module, ir.FunctionType(word, []), "get_num_threads"), []
    )
    alone = (builder.icmp_signed("<=", number, word(1)) for number in (threads, rows))
    with builder.if_else(builder.or_(*alone)) as (one, many):
        with one:
            _call(context, builder, loop, tuple_type, rows.type(0), rows, values[2])
        with many:
            # Numba's threading layers call `part` in each thread, with pieces of an array, of which there is none here.
            # What is shared: the first row that no thread has taken, rows, rows of a part, arguments.
            shares = builder.mul(threads, threads.type(PARTS))
            size = builder.udiv(builder.add(rows, builder.sub(shares, word(1))), shares)
            data = cgutils.pack_struct(builder, (word(0), rows, size, values[2]))
            given = ir.Constant(byte, None), threads, word(1), data
            places = [cgutils.alloca_once_value(builder, value) for value in given]
            launch = cgutils.get_or_insert_function(
                builder.module, ir.FunctionType(ir.VoidType(), [byte] * 5 + [word] * 3), "numba_parallel_for"
            )
            pointers = [builder.bitcast(pointer, byte) for pointer in (part, *places)]
            builder.call(launch, [*pointers, word(0), word(1), threads])
    return context.get_dummy_value()


def _loop(context: Any, module: ir.Module, body: types.Type, kinds: tuple) -> ir.Function:
    """loop(first, count, *arguments): the body's calls for `count` rows from `first` on."""
    signature = context.typing_context.resolve_function_type(body, (types.intp, *kinds), {})
    call, convention, taken = context.get_function(body, signature), context.call_conv, (types.intp, types.intp, *kinds)
    kind = convention.get_function_type(types.none, taken)
    loop = ir.Function(module, kind, name=module.get_unique_name("over_rows.loop"))
    loop.linkage = "internal"
    loop.attributes.update(LOOP)
    convention.decorate_function(loop, [str(k) for k in range(len(taken))], taken, noalias=True)
    builder = ir.IRBuilder(loop.append_basic_block())
    first, count, *values = convention.decode_arguments(builder, taken, loop)
    borrowed = [_borrowed(context, builder, kind, value) for kind, value in zip(kinds, values)]
    with cgutils.for_range(builder, count) as row:
        call(builder, (builder.add(first, row.index), *borrowed))
    convention.return_value(builder, context.get_dummy_value())
    return loop


def _part(context: Any, module: ir.Module, loop: ir.Function, kind: types.BaseTuple) -> ir.Function:
    """What a thread calls, as a threading layer wants it: part(addresses, counts, steps, data), see `over_rows`."""
    byte, word = cgutils.voidptr_t, cgutils.intp_t
    shape = ir.FunctionType(ir.VoidType(), [byte.as_pointer(), word.as_pointer(), word.as_pointer(), byte])
    part = ir.Function(module, shape, name=module.get_unique_name("over_rows.part"))
    part.linkage = "internal"
    builder = ir.IRBuilder(part.append_basic_block())
    data = ir.LiteralStructType([word, word, word, context.get_value_type(kind)])
    shared = builder.bitcast(part.args[3], data.as_pointer())
    free, *rest = (cgutils.gep_inbounds(builder, shared, 0, k) for k in range(4))
    rows, size, packed = map(builder.load, rest)
    ask, take, end = map(part.append_basic_block, ("ask", "take", "end"))
    builder.branch(ask)
    builder.position_at_end(ask)
    first = builder.atomic_rmw("add", free, size, "monotonic")
    left = builder.sub(rows, first)
    builder.cbranch(builder.icmp_signed(">", left, word(0)), take, end)
    builder.position_at_end(take)
    count = builder.select(builder.icmp_signed("<", left, size), left, size)
    _call(context, builder, loop, kind, first, count, packed)
    builder.branch(ask)
    builder.position_at_end(end)
    builder.ret_void()
    return part


def _call(
    context: Any, builder: ir.IRBuilder, loop: ir.Function, kind: types.BaseTuple, first: Any, count: Any, packed: Any
) -> None:
    values = (first, count, *cgutils.unpack_tuple(builder, packed))
    context.call_conv.call_function(builder, loop, types.none, (types.intp, types.intp, *kind.types), values)


def _borrowed(context: Any, builder: ir.IRBuilder, kind: types.Type, value: Any) -> Any:
    """The value with arrays that count no references: the caller holds them, and counting is slow between threads."""
    if isinstance(kind, types.Array):
        array = context.make_array(kind)(context, builder, value)
        array.meminfo = cgutils.get_null_value(array.meminfo.type)
        return array._getvalue()
    if isinstance(kind, types.BaseTuple):
        members = zip(kind.types, cgutils.unpack_tuple(builder, value))
        return context.make_tuple(builder, kind, [_borrowed(context, builder, *member) for member in members])
    return value


if cgutils is not None:  # else all kernels take the plain road
    type_callable(over_rows)(_typed)
    lower_builtin(over_rows, types.Any, types.Any, types.BaseTuple)(_lowered)
