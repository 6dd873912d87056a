"""What a pair function says: the fields that it reads, their order in packed rows, the number of its terms."""

import dis
import functools
import inspect
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

from numba import types

DISTANCE, SEPARATION = "r", "x_ij"
VECTOR, SCALAR, INTEGER, OTHER = "vector", "scalar", "integer", "other"  # kinds of what the loop is given


def kind_of(value: Any) -> str | None:
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


def parts_of(pair: Callable) -> list[tuple[str, str]]:
    """`field_of` each parameter."""
    return [field_of(name) for name in inspect.signature(pair).parameters]


def fields_of(pair: Callable, index: str) -> list[str]:
    """The fields that a pair function reads at the particle ("i"), at the neighbour ("j") or of the list ("ij")."""
    return [name for name, part in parts_of(pair) if part == index]


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
    known = (DISTANCE, SEPARATION)
    names = list(dict.fromkeys(n for n, index in parts_of(pair) if index != "ij" and n not in known))
    if len(names) != len(kinds):
        raise TypeError(f"pair function {pair.__name__} takes {', '.join(names)}; {len(kinds)} values are given.")
    return dict(zip(names, kinds))


class Layout(NamedTuple):
    """Which fields of the neighbour stand in which row; `rest` are read from their own arrays."""

    vectors: list[str]  # the position is ""; none if no field is packed, as the position alone is not worth it
    beside: list[str]  # the scalar behind each of the vectors, as many or fewer
    together: list[list[str]]  # rows of three or four scalars
    rest: list[str]


@functools.cache
def layout(pair: Callable, kinds: tuple[str | None, ...]) -> Layout:
    """The layout for a pair function, given the kinds of its fields at the neighbour."""
    given = dict(zip(fields_of(pair, "j"), kinds))
    vectors = ["", *(name for name, kind in given.items() if kind == VECTOR)]
    scalars = [name for name, kind in given.items() if kind == SCALAR]
    if len(vectors) == 1 and not scalars:
        vectors = []
    beside, left = scalars[: len(vectors)], scalars[len(vectors) :]
    together = [left[k : k + 4] for k in range(0, len(left), 4) if len(left) - k > 2]
    packed = {*vectors, *beside, *(name for row in together for name in row)}
    return Layout(vectors, beside, together, [n for n, kind in given.items() if n not in packed and kind is not None])
