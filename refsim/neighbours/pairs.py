"""The loop over a particle's neighbours, written once; a pair function is the paper's equation for one neighbour.

A pair function, marked `@pair`, returns the terms of its sums; its return statement writes them one by one. The names
of its parameters say what the loop reads:

    r          |x_i - x_j|, distance to the neighbour [m], less than the support radius
    x_ij       x_i - x_j, separation from the neighbour, three components [m]; with a period to its nearest image
    FIELD_i    value of a field at the particle; of an (n, 3) field three components, of None None
    FIELD_j    value of a field at the neighbour
    FIELD_ij   value that the list itself holds for this neighbour, in its array FIELD
    any other  passed on as it is: a parameter group, a number, None

`neighbour_sum` adds up the terms, in the body of a kernel or in a formula:

    @pair
    def difference(r, velocity_i, velocity_j, mass_j, smoothing): ...

    u, v, w = neighbour_sum(difference, i, lane, neighbours, position, period, velocity, mass, smoothing)

After the pair function come the particle, its lane (None in a kernel without lanes), the list, the positions, the
period or None, and then what the pair function names, in its order, each field once. The first group has the support
radius. A list with positions of its own, as of walls, is one of other particles. Without positions (None) the sum goes
over all entries of the list, near and far; its numbers have the type of FIELD, or of the first value that is no field.
A branch on a parameter that is None leaves no code. A CPU puts the fields of the near neighbours side by side before it
computes with them (`refsim.backends.fast.staging`); where the list carries packed fields, those are read ahead of use
(`refsim.neighbours.packed_cuda`).
"""

import functools
import inspect
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numba import types

from refsim.backends.compile import formula, overloaded
from refsim.backends.fast import staging
from refsim.backends.reductions import filled_in
from refsim.backends.written import NONE, function_of
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.pair_functions import (
    DISTANCE,
    OTHER,
    SCALAR,
    SEPARATION,
    VECTOR,
    fields_of,
    given_to,
    kind_of,
    layout,
    parts_of,
    terms,
)
from refsim.neighbours.rows import over_lanes, row_of

HEAD = """\
def sums(pair, i, lane, listed, places, box, {given}):
    "Sums over the neighbours of particle i of what `{pair}` gives."
"""
ROW = "    first, stride, count = row_of(listed, i, lane)\n"
PLAIN_ROWS = {
    "cpu": "for at in range(listed.start[i], listed.start[i] + listed.count[i]):",
    "cuda": "for at in range(i, i + listed.count[i] * listed.count.shape[0], listed.count.shape[0]):",
}
LOOP = """\
    real = {real}
    {zeros}
    {own}
    for k in range(count):
        at = first + k * stride
        j = listed.entries[at]
        {theirs}
        {added}
    return {totals}
"""
NEAR = """\
    h = {smoothing}.support_radius
    real = type(h)
    limit = h * h
    {zeros}
    {own}
    x, y, z = places[i, 0], places[i, 1], places[i, 2]
"""
NEAR_LOOP = """\
    for k in range(count):
        at = first + k * stride
        j = listed.entries[at]
        dx, dy, dz = x - {source}[j, 0], y - {source}[j, 1], z - {source}[j, 2]
        dx, dy, dz = to_nearest_image(dx, dy, dz, box)
        r2 = dx * dx + dy * dy + dz * dz
        if r2 < limit:
            {theirs}
            {added}
    return {totals}
"""
STAGED_LOOP = """\
    {buffers}
    for begin in range(np.uint64(0), count, np.uint64(staging.AT_A_TIME)):
        size = staging.gathered(listed.entries, first + begin, count - begin, ({arrays}), ({parts}))
        for m in range(size):
            dx, dy, dz = to_nearest_image(x - x_at[m], y - y_at[m], z - z_at[m], box)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                {theirs}
                {added}
    return {totals}
"""
PACKED_LOOP = """\
    if count > 0:
        j = listed.entries[first]
        following = j
        if count > 1:
            following = listed.entries[first + stride]
        at = first + stride
        left = np.int32(count)
        {now}
        while left > 0:
            {ahead}
            at += stride
            {entry}
            dx, dy, dz = to_nearest_image(x - x_j, y - y_j, z - z_j, box)
            r2 = dx * dx + dy * dy + dz * dz
            if r2 < limit:
                {theirs}
                {added}
            {shifted}
            left = np.int32(left - 1)
    return {totals}
"""


def pair(function: Callable) -> Callable:
    """Mark a pair function; other pair functions may call it, too. Its `packed` makes a packed program of a kernel."""
    function.packed = functools.partial(_packed, function)  # type: ignore[attr-defined]
    return formula(function)


def _packed(pair: Callable, body: Any) -> Callable:
    from refsim.neighbours.packed_cuda import packed_program  # loads numba.cuda, which a CPU does without

    return packed_program(body, pair)


def neighbour_sum(pair: Any, i: Any, lane: Any, listed: Any, position: Any, period: Any, *given: Any) -> Any:
    """Sums over the neighbours j of particle i of the terms that `pair` gives; of one term, its sum."""
    loop = _loop(pair, listed._fields, position is not None, tuple(map(kind_of, given)))
    return loop(pair, i, lane, listed, position, period, *given)


def _neighbour_sum(pair: Any, i: Any, lane: Any, listed: Any, position: Any, period: Any, *given: Any) -> Any:
    near = not isinstance(position, types.NoneType)
    return _loop(pair.typing_key, listed.fields, near, tuple(map(kind_of, given)))


def _written(kinds: Any) -> Callable:
    """The loop for kinds of `refsim.backends.written`."""
    pair: Any
    listed: Any
    pair, _, _, listed, position, _, *given = [None if kind == NONE else kind for kind in kinds]
    kinds = tuple(kind and {1: SCALAR, 2: VECTOR}.get(getattr(kind, "ndim", 0), OTHER) for kind in given)
    return _loop(pair.value, listed.names, position is not None, kinds, plain=True)


overloaded(neighbour_sum, _neighbour_sum, forceinline=True)
neighbour_sum.written = _written  # type: ignore[attr-defined]


@functools.cache
def _loop(
    pair: Callable, listed: tuple[str, ...], near: bool, kinds: tuple[str | None, ...], plain: bool = False
) -> Callable:
    """The loop for a pair function, a list with these members, near neighbours or all, and arguments of these kinds."""
    given, sums, held = given_to(pair, kinds), range(terms(pair)), fields_of(pair, "ij")
    space: dict[str, Any] = {"terms_of": pair, "math": math, "row_of": row_of, "over_lanes": over_lanes}
    space["to_nearest_image"] = to_nearest_image
    other = next((name for name, index in parts_of(pair) if name in given and not index), "")
    lines = {
        "own": [f"{name}_i = {entry_of(name, given[name], 'i')}" for name in fields_of(pair, "i")],
        "zeros": [f"s{n} = real(0)" for n in sums],
        "added": added(pair),
    }
    source = "listed.position" if "position" in listed else "places"
    loop = NEAR + NEAR_LOOP if near else LOOP
    parts: dict[str, str] = {}
    if near and "rows" in listed:
        from refsim.backends.primitives import four_of  # loads numba.cuda, which a CPU does without

        lines |= _packed_lines(pair, given)
        loop, space = NEAR + PACKED_LOOP, space | {"four_of": four_of, "np": np}
    elif near and "start" in listed and not held and not plain:
        staged, parts = _staged(pair, given, source)
        lines, loop, space = lines | staged, NEAR + STAGED_LOOP, space | {"staging": staging, "np": np}
    else:
        lines["theirs"] = [f"{name}_j = {entry_of(name, given[name], 'j')}" for name in fields_of(pair, "j")]
        lines["theirs"] += [f"{name}_ij = listed.{name}[at]" for name in held]
    if plain:
        rows = PLAIN_ROWS["cpu" if "start" in listed else "cuda"]
        loop = loop.replace("for k in range(count):\n        at = first + k * stride", rows)
    text = filled_in(
        HEAD + ("" if plain else ROW) + loop, lines, given=", ".join(given), pair=pair.__name__,
        smoothing=other, real=f"listed.{held[0]}.dtype.type" if held else f"type({other})",
        source=source, totals=", ".join(f"over_lanes(s{n}, lane)" for n in sums), **parts,
    )  # fmt: skip
    path = f"<{pair.__module__}.{pair.__qualname__} {listed} {near} {kinds} {plain}>"
    made = function_of(text, "sums", path, space)
    made.shown_as = f"sum_of_{pair.__name__}"
    return made


def _staged(pair: Callable, given: Mapping[str, str | None], source: str) -> tuple[dict[str, Any], dict[str, str]]:
    """Lines of the loop over staged fields; the arrays that it stages, the positions first, and their buffers."""
    wide = {name: 3 if given[name] == VECTOR else 1 for name in fields_of(pair, "j") if given[name] is not None}
    buffers = {source: ["x_at", "y_at", "z_at"]} | {n: [f"{n}_at{c}" for c in range(w)] for n, w in wide.items()}
    parts = {name: ", ".join(f"{part}[m]" for part in buffers.get(name, ())) for name in fields_of(pair, "j")}
    lines = {
        "buffers": [f"{part} = staging.buffer({array})" for array, parts in buffers.items() for part in parts],
        "theirs": [f"{name}_j = ({values})" if values else f"{name}_j = None" for name, values in parts.items()],
    }
    named = (f"{part}, " for parts in buffers.values() for part in parts)
    return lines, {"arrays": "".join(f"{array}, " for array in buffers), "parts": "".join(named)}


def _packed_lines(pair: Callable, given: Mapping[str, str | None]) -> dict[str, list[str]]:
    """Lines of the loop over packed fields."""
    row_layout = layout(pair, tuple(given[name] for name in fields_of(pair, "j")))

    def row(vector: str, scalar: str, at: str) -> list[str]:
        names = [f"{c}_{at}" for c in "xyz"] if not vector else [f"{vector}_{at}{c}" for c in range(3)]
        return [*names, f"{scalar}_{at}" if scalar else "_"]

    def read(at: str, index: str) -> tuple[list[str], list[str]]:
        """Lines that read all fields of the neighbour `index`, and their names."""
        beside = [*row_layout.beside, *[""] * (len(row_layout.vectors) - len(row_layout.beside))]
        rows = [row(vector, scalar, at) for vector, scalar in zip(row_layout.vectors, beside)]
        rows += [[*(f"{name}_{at}" for name in names), *"_" * (4 - len(names))] for names in row_layout.together]
        lines = [f"{', '.join(names)} = four_of(listed.rows[{n}], {index})" for n, names in enumerate(rows)]
        lines += [f"{name}_{at} = {name}[{index}]" for name in row_layout.rest]
        if not rows:
            rows = [[f"{c}_{at}" for c in "xyz"]]
            lines.append(f"{', '.join(rows[0])} = {entry_of('places', VECTOR, index)}")
        names = [name for names in rows for name in names if name != "_"]
        return lines, [*names, *(f"{name}_{at}" for name in row_layout.rest)]

    now, held = read("j", "j")
    ahead, read_ahead = read("n", "following")
    shifted = [f"{', '.join(held)} = {', '.join(read_ahead)}"]
    entry = ["if left > 3:", "    after = listed.entries[at]"]
    if len(row_layout.vectors) + len(row_layout.together) + len(row_layout.rest) == 1:  # more threads serve better
        entry = ["if left > 2:", "    following = listed.entries[at]"]
        now, ahead, shifted = [], [*now, "j = following"], []
    else:
        now = ["after = following", "if count > 2:", "    after = listed.entries[at + stride]", "at += stride", *now]
        ahead = [*ahead, "following = after"]
    return {
        "now": [*now, *(f"{name}_j = None" for name in fields_of(pair, "j") if given[name] is None)],
        "ahead": ahead,
        "entry": entry,
        "theirs": [f"{v}_j = ({v}_j0, {v}_j1, {v}_j2)" for v in row_layout.vectors[1:]],
        "shifted": shifted,
    }


def entry_of(name: str, kind: str | None, index: str) -> str:
    """Expression for the value of a field."""
    if kind is None:
        return "None"
    return f"({', '.join(f'{name}[{index}, {c}]' for c in range(3))})" if kind == VECTOR else f"{name}[{index}]"


def added(pair: Callable) -> list[str]:
    """Lines that call the pair function and add up its terms."""
    values = {DISTANCE: "math.sqrt(r2)", SEPARATION: "(dx, dy, dz)"}
    call = f"terms_of({', '.join(values.get(name, name) for name in inspect.signature(pair).parameters)})"
    sums = range(terms(pair))
    return [f"{', '.join(f't{n}' for n in sums)} = {call}", *(f"s{n} += t{n}" for n in sums)]
