"""A sum over neighbours on a GPU that reads their fields packed, four numbers at once, and ahead of their use.

A loop that reads an entry of the list, then that neighbour's fields, then computes, waits for the memory twice in each
round. Here entries are read three rounds ahead and fields one; only entries, two rounds, where the fields are one row.
`packed_program` makes such a program of a kernel and the pair function of its sum; several sums over `neighbours` in a
kernel read the same fields of the neighbour. It is compiled for one shape of the smoothing kernel.
"""

import inspect
from collections import namedtuple
from collections.abc import Callable, Mapping
from typing import Any

from refsim.backends import device
from refsim.backends.compile import Kernel, row_kernel
from refsim.backends.primitives import set_four
from refsim.neighbours.pair_functions import Layout, fields_of, kind_of, layout
from refsim.smoothing.shapes import Smoothing

# NeighbourColumns with the neighbours' fields as `rows`: a tuple of (n, 4) arrays, in the order of `layout`
PackedColumns = namedtuple("PackedColumns", "count entries lanes rows")


def packed_program(body: Kernel, pair: Callable) -> Callable:
    """The body's program for CUDA with the fields that `pair` reads of a neighbour packed; takes `scratch` first."""
    kernel, names, fields = body.on("cuda"), body.arguments, fields_of(pair, "j")

    def program(scratch: Any, *values: Any) -> None:
        given = {name: v.fixed() if isinstance(v, Smoothing) else v for name, v in zip(names, values)}
        row_layout = layout(pair, tuple(kind_of(given[name]) for name in fields))
        given["neighbours"] = packed(row_layout, given, scratch)
        kernel(*given.values())

    parameter = inspect.Parameter.POSITIONAL_OR_KEYWORD
    program.__name__, program.__doc__ = body.__name__, body.__doc__
    program.__signature__ = inspect.Signature(  # type: ignore[attr-defined]
        [inspect.Parameter(name, parameter) for name in ("scratch", *names)]
    )
    return program


def packed(row_layout: Layout, given: Mapping[str, Any], scratch: Any) -> PackedColumns:
    """The list `neighbours` with the fields of a layout, in scratch memory."""
    neighbours, position = given["neighbours"], given["position"]
    count = len(row_layout.vectors) + len(row_layout.together)
    rows = tuple(scratch.array(f"packed {k}", (position.shape[0], 4), position.dtype) for k in range(count))
    vectors = tuple(given[name] if name else position for name in row_layout.vectors)
    held = row_layout.beside[:1] if row_layout.beside[:1] in (["mass"], ["volume"]) else []
    first = int(scratch.packs((position, given[held[0]]) if held else ()))
    if first < len(vectors):
        scalars = tuple(given[name] for name in row_layout.beside) or (neighbours.count,)
        scalars = (*scalars, *[scalars[0]] * (len(vectors) - len(scalars)))
        device.packed(vectors[first:], scalars[first:], rows[first : len(vectors)])
    for names, out in zip(row_layout.together, rows[len(vectors) :]):
        together = tuple(given[name] for name in names)
        pack_scalars((*together, *[together[0]] * (4 - len(together))), out)
    return PackedColumns(neighbours.count, neighbours.entries, neighbours.lanes, rows)


@row_kernel
def pack_scalars(i, scalars, out):
    """out[i] (4,) = the four scalars of particle i."""
    set_four(out, i, scalars[0][i], scalars[1][i], scalars[2][i], scalars[3][i])
