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
A branch on a parameter that is None leaves no code. Where the list carries packed fields, those are read, ahead of
their use (`refsim.neighbours.packing`).
"""

from __future__ import annotations

import dis
import functools
import inspect
import itertools
import linecache
import math
from collections.abc import Callable, Mapping
from typing import Any

from numba import types

from refsim.backends.compile import formula, overloaded
from refsim.neighbours.formulas import to_nearest_image
from refsim.neighbours.rows import over_lanes, row_of

DISTANCE, SEPARATION = "r", "x_ij"
VECTOR, SCALAR, INTEGER, OTHER = "vector", "scalar", "integer", "other"  # kinds of what the loop is given

LOOP = """\
def sums(pair, i, lane, listed, places, box, {given}):
    first, stride, count = row_of(listed, i, lane)
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
NEAR_LOOP = """\
def sums(pair, i, lane, listed, places, box, {given}):
    first, stride, count = row_of(listed, i, lane)
    h = {smoothing}.support_radius
    real = type(h)
    limit = h * h
    {zeros}
    {own}
    x, y, z = places[i, 0], places[i, 1], places[i, 2]
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


def pair(function: Callable) -> Callable:
    """Mark a pair function; other pair functions may call it, too."""
    return formula(function)


def neighbour_sum(pair: Any, i: Any, lane: Any, listed: Any, position: Any, period: Any, *given: Any) -> Any:
    """Sums over the neighbours j of particle i of the terms that `pair` gives; of one term, its sum."""
    loop = _loop(pair, listed._fields, position is not None, tuple(map(_kind, given)))
    return loop(pair, i, lane, listed, position, period, *given)


def _neighbour_sum(pair: Any, i: Any, lane: Any, listed: Any, position: Any, period: Any, *given: Any) -> Any:
    near = not isinstance(position, types.NoneType)
    return _loop(pair.typing_key, listed.fields, near, tuple(map(_kind, given)))


overloaded(neighbour_sum, _neighbour_sum, forceinline=True)


def _kind(value: Any) -> str | None:
    """Kind of an argument, or of its type; None for None."""
    if value is None or isinstance(value, types.NoneType):
        return None
    if not getattr(value, "ndim", 0):
        return OTHER
    if value.ndim == 2:
        return VECTOR
    return SCALAR if isinstance(value.dtype, types.Float) or getattr(value.dtype, "kind", "") == "f" else INTEGER


def field_of(parameter: str) -> tuple[str, str]:
    """(field, "i", "j" or "ij") of a pair function's parameter, (parameter, "") of one that is no field."""
    field, _, index = parameter.rpartition("_")
    if parameter in (DISTANCE, SEPARATION) or not field or index not in ("i", "j", "ij"):
        return parameter, ""
    return field, index


def terms(pair: Callable) -> int:
    """Number of terms that a pair function returns."""
    code = list(dis.get_instructions(pair))
    written = [before for before, last in itertools.pairwise(code) if last.opname == "RETURN_VALUE"]
    counts = {before.arg if before.opname == "BUILD_TUPLE" else 1 for before in written}
    if len(counts) != 1:
        raise TypeError(f"pair function {pair.__name__}: its return statements write different numbers of terms.")
    return counts.pop() or 0


def given_to(pair: Callable, kinds: tuple[str | None, ...]) -> dict[str, str | None]:
    """{name: kind} of what `neighbour_sum` is given for a pair function: each field once, and what is no field."""
    parts = map(field_of, inspect.signature(pair).parameters)
    names = list(dict.fromkeys(name for name, index in parts if index != "ij" and name not in (DISTANCE, SEPARATION)))
    if len(names) != len(kinds):
        raise TypeError(f"pair function {pair.__name__} takes {', '.join(names)}; {len(kinds)} values are given.")
    return dict(zip(names, kinds))


@functools.cache
def _loop(pair: Callable, listed: tuple[str, ...], near: bool, kinds: tuple[str | None, ...]) -> Callable:
    """The loop for a pair function, a list with these members, near neighbours or all, and arguments of these kinds."""
    text = loop_source(pair, listed, near, given_to(pair, kinds))
    path = f"<{pair.__module__}.{pair.__qualname__} {listed} {near} {kinds}>"
    linecache.cache[path] = (len(text), None, text.splitlines(keepends=True), path)
    space: dict[str, Any] = {"terms_of": pair, "math": math, "row_of": row_of, "over_lanes": over_lanes}
    space |= {"to_nearest_image": to_nearest_image}
    exec(compile(text, path, "exec"), space)
    return space["sums"]


def loop_source(pair: Callable, listed: tuple[str, ...], near: bool, given: Mapping[str, str | None]) -> str:
    """The loop as Python."""
    parts = [field_of(name) for name in inspect.signature(pair).parameters]
    sums = range(terms(pair))
    held = [name for name, index in parts if index == "ij"]
    other = next((name for name, kind in given.items() if (name, "") in parts), "")
    lines = {
        "own": [f"{name}_i = {entry_of(name, given[name], 'i')}" for name, index in parts if index == "i"],
        "theirs": [f"{name}_j = {entry_of(name, given[name], 'j')}" for name, index in parts if index == "j"]
        + [f"{name}_ij = listed.{name}[at]" for name in held],
        "zeros": [f"s{n} = real(0)" for n in sums],
        "added": added(pair),
    }
    return filled_in(
        NEAR_LOOP if near else LOOP,
        lines,
        given=", ".join(given),
        smoothing=other,
        real=f"listed.{held[0]}.dtype.type" if held else f"type({other})",
        source="listed.position" if "position" in listed else "places",
        totals=", ".join(f"over_lanes(s{n}, lane)" for n in sums),
    )


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


def filled_in(template: str, lines: Mapping[str, list[str]], **words: str) -> str:
    """The template with words in its lines, and with several lines, or none, in place of a line."""
    text = []
    for line in template.splitlines():
        name = line.strip()[1:-1]
        if line.strip() == f"{{{name}}}" and name in lines:
            text += [line[: len(line) - len(line.lstrip())] + part for part in lines[name]]
        else:
            text.append(line.format(**words))
    return "\n".join(text) + "\n"
