"""Values of a particle's neighbours side by side, for CPU kernels: `buffer` to put them, and `gathered`, which does.

A processor that gathers eight values reads one after the other, and once more for each component of a vector. Here the
components of a vector are one read, of four neighbours at a time, and the loop that follows reads side by side what it
computes side by side.
"""

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

from refsim.backends.written import function_of

AT_A_TIME = 128  # neighbours that are staged
STAGED = """\
def gathered(entries, first, count, arrays, buffers):
    size = min(count, np.uint64(AT_A_TIME))
    for m in range(size):
        j = entries[first + m]"""
FOUR, WIDE = 4, 8  # neighbours that are read together, and that a loop computes together at most


def buffer(array: Any) -> Any:
    """Memory for one component of AT_A_TIME rows of `array`; compiled, on the stack, with whatever stands there."""
    return np.empty(AT_A_TIME, array.dtype)


def gathered(entries: Any, first: Any, count: Any, arrays: tuple, buffers: tuple) -> Any:
    """Put the rows entries[first], entries[first + 1], ... of the arrays into the buffers; the number of values there.

    These are `count` rows, AT_A_TIME at most. An (n, 3) array has a buffer for each component, an (n,) array one. The
    first array is one of positions. Compiled code fills the buffers up to a multiple of WIDE, so that it needs no other
    loop for a rest: the first buffer with infinity, so that what stands there is nowhere near.
    """
    rows = entries[int(first) : int(first) + min(int(count), AT_A_TIME)]
    columns = [column for array in arrays for column in (array.T if array.ndim == 2 else (array,))]
    for column, part in zip(columns, buffers):
        part[: len(rows)] = column[rows]
    return len(rows)


def _written(kinds: Any) -> Any:
    """`gathered` for kinds of `refsim.backends.written`: a loop over the rows."""
    columns = [f"{n}][j{f', {c}' if kind.ndim == 2 else ''}" for n, kind in enumerate(kinds[3].parts)
               for c in range(3 if kind.ndim == 2 else 1)]  # fmt: skip
    lines = [f"        buffers[{k}][m] = arrays[{column}]" for k, column in enumerate(columns)]
    text = "\n".join([STAGED, *lines, "    return size\n"])
    return function_of(text, "gathered", f"<gathered {columns}>", {"np": np, "AT_A_TIME": AT_A_TIME})


gathered.written = _written  # type: ignore[attr-defined]


def _placed(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> Any:
    """`buffer`, on the stack."""
    kind = context.get_data_type(signature.return_type.dtype)
    with builder.goto_entry_block():
        data = builder.alloca(ir.ArrayType(kind, AT_A_TIME + WIDE))
    data.align = 64
    made = context.make_array(signature.return_type)(context, builder)
    size, item = (context.get_constant(types.intp, n) for n in (AT_A_TIME, context.get_abi_sizeof(kind)))
    made.data = builder.bitcast(data, made.data.type)
    made.nitems, made.itemsize = size, item
    made.shape, made.strides = (builder.insert_value(made.shape, value, 0) for value in (size, item))
    made.meminfo, made.parent = (ir.Constant(pointer.type, None) for pointer in (made.meminfo, made.parent))
    return made._getvalue()


def _read(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> Any:
    """`gathered`: a loop over groups of four, and one group more for a rest."""
    entries, _, _, arrays, buffers = signature.args
    word = ir.IntType(types.intp.bitwidth)

    def opened(kinds: Any, packed: Any) -> list[Any]:
        members = [builder.extract_value(packed, n) for n in range(len(kinds))]
        return [context.make_array(kind)(context, builder, value) for kind, value in zip(kinds, members)]

    begin = builder.gep(context.make_array(entries)(context, builder, values[0]).data, [values[1]])
    sources, places = opened(arrays, values[3]), iter([array.data for array in opened(buffers, values[4])])
    parts = [[next(places) for _ in range(3 if kind.ndim == 2 else 1)] for kind in arrays]
    most = word(AT_A_TIME)
    number = builder.select(builder.icmp_unsigned("<", values[2], most), values[2], most)

    def store_at(part: Any, at: Any, value: Any) -> None:
        store = builder.store(value, builder.bitcast(builder.gep(part, [at]), value.type.as_pointer()))
        store.align = context.get_abi_sizeof(value.type.element)

    def four(at: Any, numbers: list[Any]) -> None:
        rows = [builder.zext(builder.load(builder.gep(begin, [m])), word) for m in numbers]
        for kind, source, part_of in zip(arrays, sources, parts):
            for part, value in zip(part_of, _components(context, builder, kind, source, rows)):
                store_at(part, at, value)

    whole = builder.and_(number, word(-FOUR))
    start, loop, rest = builder.block, builder.append_basic_block("four"), builder.append_basic_block("rest")
    builder.cbranch(builder.icmp_unsigned("<", word(0), whole), loop, rest)
    builder.position_at_end(loop)
    at = builder.phi(word)
    four(at, [builder.add(at, word(n)) for n in range(FOUR)])
    following = builder.add(at, word(FOUR))
    at.add_incoming(word(0), start)
    at.add_incoming(following, builder.block)
    builder.cbranch(builder.icmp_unsigned("<", following, whole), loop, rest)
    builder.position_at_end(rest)
    with builder.if_then(builder.icmp_unsigned("<", whole, number)):
        last = builder.sub(number, word(1))
        beyond = [builder.add(whole, word(n)) for n in range(FOUR)]
        four(whole, [builder.select(builder.icmp_unsigned("<", m, last), m, last) for m in beyond])
    item = parts[0][0].type.pointee
    store_at(parts[0][0], number, ir.Constant(ir.VectorType(item, WIDE), [item(math.inf)] * WIDE))
    return builder.and_(builder.add(number, word(WIDE - 1)), word(-WIDE))


def _components(context: Any, builder: ir.IRBuilder, kind: Any, source: Any, rows: list[Any]) -> list[Any]:
    """Vectors of four: the values of an array at four rows, or of an (n, 3) array those of each component."""

    def shuffled(a: Any, b: Any, *order: int) -> Any:
        return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(ir.IntType(32), len(order)), list(order)))

    if kind.layout == "C":
        length = rows[0].type(3 if kind.ndim == 2 else 1)
        places = [builder.gep(source.data, [builder.mul(row, length)]) for row in rows]
    else:
        base = builder.bitcast(source.data, ir.IntType(8).as_pointer())
        stride = builder.extract_value(source.strides, 0)
        places = [builder.bitcast(builder.gep(base, [builder.mul(row, stride)]), source.data.type) for row in rows]
    item = source.data.type.pointee
    if kind.ndim == 1:
        four: Any = ir.Constant(ir.VectorType(item, FOUR), ir.Undefined)
        for n, place in enumerate(places):
            four = builder.insert_element(four, builder.load(place), ir.IntType(32)(n))
        return [four]
    vectors = [builder.load(builder.bitcast(place, ir.VectorType(item, 3).as_pointer())) for place in places]
    for load in vectors:
        load.align = context.get_abi_sizeof(item)
    a, b, c, d = vectors
    low, lower = shuffled(a, b, 0, 3, 1, 4), shuffled(c, d, 0, 3, 1, 4)
    high, higher = shuffled(a, b, 2, 5), shuffled(c, d, 2, 5)
    return [
        shuffled(low, lower, 0, 1, 4, 5), shuffled(low, lower, 2, 3, 6, 7), shuffled(high, higher, 0, 1, 2, 3)
    ]  # fmt: skip


type_callable(buffer)(lambda context: lambda array: types.Array(array.dtype, 1, "C"))
lower_builtin(buffer, types.Array)(_placed)
type_callable(gathered)(lambda context: lambda entries, first, count, arrays, buffers: types.uint64)
lower_builtin(gathered, types.Array, types.Any, types.Any, types.BaseTuple, types.BaseTuple)(_read)
