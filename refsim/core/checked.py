"""Values of scenes and effects are compared with their types; an error names the field, in TOML as in Python."""

import difflib
import functools
import itertools
import os
import re
import typing
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, ClassVar

import msgspec
import numpy as np

from refsim.core.errors import InputError

IN_TOML = {
    "float": "a number",
    "int": "a whole number",
    "str": "text in quotes",
    "bool": "true or false",
    "array": "a list in square brackets",
    "object": "a table",
    "null": "nothing",
}
IN_PYTHON = IN_TOML | {"str": "text", "bool": "True or False", "array": "a tuple or a list", "null": "None"}


Printed = tuple[str, ...] | str  # type of `literal`: readings of a source, or one of them, "paper" or "all"
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Count = Annotated[int, msgspec.Meta(ge=1)]
SIDES = {">": "more than", ">=": "at least", "<": "less than", "<=": "at most"}  # of the bound that a type sets


class Checked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of what a scene is made of: a value of the wrong kind or out of its range is refused when it is made.

    Raises InputError, which names effect or class, field and value.
    """

    says_why: ClassVar[tuple[str, ...]] = ()  # fields whose impossible choices the class explains in a check of its own
    removed: ClassVar[Mapping[str, str]] = {}  # former choices, and what to give in their place

    def __post_init__(self) -> None:
        for name, kind in _kinds(type(self)):
            value = getattr(self, name)
            if name in self.says_why and isinstance(value, str):
                continue
            try:
                msgspec.convert(as_plain(value), kind)
            except (msgspec.ValidationError, OverflowError) as error:
                words = IN_PYTHON | {"object": _classes(kind)}
                raise InputError(
                    f"{_called(type(self))}: {name}{why(error, value, kind, words, self.removed)}"
                ) from None


def _called(owner: type) -> str:
    """The name of an effect in scene files, else that of the class."""
    name = vars(owner).get("name")
    return name if isinstance(name, str) and name else owner.__name__


@functools.cache
def _kinds(owner: type) -> tuple[tuple[str, Any], ...]:
    """(name, type) of the fields of a struct whose type says something."""
    return tuple((f.name, f.type) for f in msgspec.structs.fields(owner) if f.type is not Any)


def _classes(kind: Any) -> str:
    """The structs inside a type, in words."""
    inner = typing.get_args(kind)
    found = [k.__name__ for k in (kind, *inner, *itertools.chain.from_iterable(map(typing.get_args, inner)))
             if isinstance(k, type) and issubclass(k, msgspec.Struct)]  # fmt: skip
    return " or ".join(found) if found else "a mapping"


def as_plain(value: Any) -> Any:
    """`value` with lists and numbers of Python in place of NumPy's, and text in place of paths."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, list | tuple):
        return [as_plain(v) for v in value]
    return os.fspath(value) if isinstance(value, os.PathLike) else value


def why(
    error: Exception, value: Any, kind: Any, words: Mapping[str, str] = IN_TOML,
    removed: Mapping[str, str] | None = None,
) -> str:  # fmt: skip
    """Why msgspec could not convert `value`, as the rest of a sentence that begins with the place."""
    if isinstance(error, OverflowError):
        return f" = {_short(value)} is too large for a number; check it."
    said, _, path = str(error).partition(" - at `$")
    inside, found = path.rstrip("`"), value
    for index in re.findall(r"\[(\d+)\]", inside):
        found = found[int(index)]
    if inside.endswith("[...]"):  # of a table of lists, without its key
        key, found = next(((key, part) for key, part in found.items() if not isinstance(part, list)), ("", found))
        inside = inside.replace("[...]", f".{key}")
    if said.startswith("Invalid enum value"):
        choices = _choices(kind)
        if removed and found in removed:
            return f"{inside} = {found!r} was removed; give {removed[found]!r}."
        if isinstance(found, str):
            return f"{inside} = {found!r} is not possible; {suggestion(found, map(str, choices))}"
        return f"{inside} = {found!r} is not possible; choose from {', '.join(map(repr, choices))}."
    if bound := re.match(r"Expected `\w+` ([<>]=?) (\S+)", said):
        zero = {">": "a positive number", ">=": "zero or a positive number"} if float(bound[2]) == 0 else {}
        limit = zero.get(bound[1], f"{SIDES[bound[1]]} {float(bound[2]):g}")
        return f"{inside} = {_short(found)} is not possible; give {limit}."
    match = re.match(r"Expected `([^`]+)`(?: of length (?:at least )?(\d+))?", said)
    if not match:
        return f"{inside} = {_short(found)} is not possible ({said[:1].lower()}{said[1:]}); correct it."
    if match[2]:
        return f"{inside} has {len(found)} values; give {match[2]}."
    expected = " or ".join(words.get(name, name) for name in match[1].split(" | "))
    return f"{inside} = {_short(found)} is {word_for(found)}; give {expected}."


def given_keys(part: Any, owner: str, takes: Mapping[str, tuple[str, ...]]) -> list[str]:
    """Those keys of a part of a scene, of which each kind takes some, that are given.

    Raises InputError, beginning with `owner`, for one that the part's kind does not take.
    """
    keys = dict.fromkeys(itertools.chain(*takes.values()))
    given = [key for key in keys if getattr(part, key) not in (None, "")]
    for key in given:
        if key not in takes[part.kind]:
            kind = f"{type(part).__name__.lower()} of kind {part.kind!r}"
            raise InputError(f"{owner}: a {kind} takes no {key!r}; it takes {', '.join(takes[part.kind])}.")
    return given


def word_for(value: Any) -> str:
    """What kind of value this is, in words."""
    for kind, word in (
        (bool, "true or false"),
        (int, "a whole number"),
        (float, "a number with decimals"),
        (str, "text"),
        (list, "a list"),
        (dict, "a table"),
    ):
        if isinstance(value, kind):
            return word
    return f"a {type(value).__name__}"


def suggestion(word: str, known: Iterable[str]) -> str:
    """ "did you mean X?", or all known words if none is similar."""
    known = list(known)
    near = difflib.get_close_matches(str(word).lower(), known, n=1, cutoff=0.55)
    return f"did you mean {near[0]}?" if near else f"choose from {', '.join(known)}."


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _choices(kind: Any) -> list[Any]:
    """All literal values inside a type."""
    if typing.get_origin(kind) is typing.Literal:
        return list(typing.get_args(kind))
    return list(dict.fromkeys(itertools.chain.from_iterable(map(_choices, typing.get_args(kind)))))
