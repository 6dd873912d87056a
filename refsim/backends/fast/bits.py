"""Marks of an array as bits of a word, for CPU kernels: `marked` reads 64 at a time, `lowest` finds one."""

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import lower_builtin, type_callable

WORD = 64  # marks of a word


def marked(marks: Any, first: Any) -> Any:
    """Bit k says whether marks[first + k] is not 0; `marks` is an array of bytes."""
    bits = np.uint64(0)
    for k in range(WORD):
        if marks[np.uint64(first) + np.uint64(k)] != 0:
            bits |= np.uint64(1) << np.uint64(k)
    return bits


def lowest(bits: Any) -> Any:
    """The number of the lowest bit that is set; one is."""
    number = np.uint64(0)
    while (bits >> number) & np.uint64(1) == np.uint64(0):
        number += np.uint64(1)
    return number


def _marked(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, values[0])
    kind = ir.VectorType(ir.IntType(8), WORD)
    word = builder.load(builder.bitcast(builder.gep(array.data, [values[1]]), kind.as_pointer()))
    word.align = 1
    return builder.bitcast(builder.icmp_unsigned("!=", word, ir.Constant(kind, [0] * WORD)), ir.IntType(WORD))


def _lowest(context: Any, builder: ir.IRBuilder, signature: Any, values: Any) -> Any:
    return builder.cttz(values[0], ir.IntType(1)(1))


type_callable(marked)(lambda context: lambda marks, first: types.uint64)
lower_builtin(marked, types.Array, types.Integer)(_marked)
type_callable(lowest)(lambda context: lambda bits: types.uint64)
lower_builtin(lowest, types.Integer)(_lowest)
