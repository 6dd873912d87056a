"""Values of scenes and effects are compared with their types; an error names the field, in TOML as in Python."""

import collections.abc
import functools
import inspect
import itertools
import operator
import os
import re
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Annotated, Any, ClassVar, ParamSpec, TypeVar

import msgspec
import numpy as np

from refsim.core.errors import InputError

IN_TOML = {"float": "a number", "int": "a whole number", "str": "text in quotes", "bool": "true or false"}
IN_TOML |= {"array": "a list in square brackets", "object": "a table", "null": "nothing"}
IN_PYTHON = IN_TOML | {"str": "text", "bool": "True or False", "array": "a tuple or a list", "null": "None"}


Printed = tuple[str, ...] | str  # type of `literal`: readings of a source, or one of them, "paper" or "all"
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Count = Annotated[int, msgspec.Meta(ge=1)]
SIDES = {">": "more than", ">=": "at least", "<": "less than", "<=": "at most"}  # of the bound that a type sets
# Of classes in annotations
WORDS = IN_PYTHON | {"NoneType": "None", "PathLike": "a path", "Callable": "a function", "Mapping": "a mapping"}
WORDS |= dict.fromkeys(("Sequence", "Iterable"), "a tuple or a list")
MAKERS = {"Scene": " (load_scene reads a file)"}
P = ParamSpec("P")
R = TypeVar("R")


class _Named(msgspec.StructMeta):
    """Classes whose fields are given by name; one that is not there, or is left out, is said in a sentence."""

    def __call__(cls, *given: Any, **named: Any) -> Any:
        try:
            return super().__call__(*given, **named)
        except TypeError:
            signature = inspect.signature(cls)
            by_name = all(p.kind is p.KEYWORD_ONLY for p in signature.parameters.values())
            words = f" takes no value without a name; its names are {', '.join(cls.__struct_fields__)}."
            said = words if given and by_name else _misfit(signature, given, named)
            if not said:
                raise
        raise InputError(f"{_called(cls)}{said}")


class Checked(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, metaclass=_Named):
    """Base of what a scene is made of: a value of the wrong kind or out of its range is refused when it is made.

    It keeps tuples in place of lists, and copies of arrays that cannot be written to; equal ones have one hash.

    Raises InputError, which names effect or class, field and value.
    """

    removed: ClassVar[Mapping[str, str]] = {}  # former choices, and what to give in their place

    def __post_init__(self) -> None:
        typed = {name for name, _ in _kinds(type(self))}
        for name in self.__struct_fields__:
            value = getattr(self, name)
            if (kept := _kept(value, name in typed)) is not value:
                msgspec.structs.force_setattr(self, name, kept)
        for name, kind in _kinds(type(self)):
            value = getattr(self, name)
            try:
                msgspec.convert(as_plain(value), kind)
            except (msgspec.ValidationError, OverflowError) as error:
                type_names = IN_PYTHON | {"object": _classes(kind)}
                raise InputError(
                    f"{_called(type(self))}: {name}{why(error, value, kind, type_names, self.removed)}"
                ) from None

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Checked) and _values(self) == _values(other)

    def __hash__(self) -> int:
        return hash(_values(self))


def _kept(value: Any, typed: bool) -> Any:
    """`value`, or what stands for it in what does not change: tuples, numbers of Python; untyped arrays are copied."""
    if isinstance(value, np.ndarray | np.generic) and typed:
        return _kept(value.tolist(), typed)
    if isinstance(value, np.ndarray):
        value = value.copy()
        value.setflags(write=False)
    elif isinstance(value, list | tuple):
        kept = tuple(_kept(v, typed) for v in value)
        return value if isinstance(value, tuple) and all(map(operator.is_, kept, value)) else kept
    return value


def _values(value: Any) -> Any:
    """Class and values of a struct, a tuple or an array, as what has a hash."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, tuple):
        return tuple(map(_values, value))
    if isinstance(value, Checked):
        return type(value), *(_values(getattr(value, f)) for f in value.__struct_fields__)
    return value


def plainly(function: Callable[P, R]) -> Callable[P, R]:
    """The function; what it cannot take is said in one sentence, before it is called.

    That is an argument that it has not, one that is left out, or a value of another kind than its annotations say.
    Raises InputError.
    """
    place = re.sub(r"\.__\w+__$", "", function.__qualname__)

    @functools.wraps(function)
    def call(*given: P.args, **named: P.kwargs) -> R:
        signature, kinds = _arguments(function)
        try:
            values = signature.bind(*given, **named).arguments
        except TypeError:
            raise InputError(f"{place}{_misfit(signature, given, named)}") from None
        for name, value in values.items():
            if name in kinds and not _is_of(value, kinds[name]):
                expected = " or ".join(dict.fromkeys(_kinds_in_words(kinds[name])))
                raise InputError(f"{place}: {name} = {_short(value)} is {word_for(value)}; give {expected}.")
            if isinstance(value, str | os.PathLike) and "\0" in str(value):
                raise InputError(f"{place}: {name} = {str(value)!r} has a zero character; leave it out.")
        return function(*given, **named)

    return call


@functools.cache
def _arguments(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    """Signature of a function, and the kinds of those arguments that are one value each."""
    signature = inspect.signature(function)
    written = {
        p.name: p.annotation
        for p in signature.parameters.values()
        if p.annotation is not p.empty and p.kind not in (p.VAR_POSITIONAL, p.VAR_KEYWORD)
    }
    holder = types.SimpleNamespace(__annotations__=written)  # without what is returned, which may not be imported
    return signature, typing.get_type_hints(holder, inspect.unwrap(function).__globals__)


def _misfit(signature: inspect.Signature, given: tuple[Any, ...], named: Mapping[str, Any]) -> str:
    """Why a function cannot be called so, as the rest of a sentence."""
    parameters = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    known = [p.name for p in parameters if p.name not in ("self", "cls")]
    for name in named if len(parameters) == len(signature.parameters) else ():
        if name not in known:
            return f": there is no {name!r}; {suggestion(name, known)}"
    unnamed = [p.name for p in parameters if p.kind is p.POSITIONAL_OR_KEYWORD]
    if len(given) > len(unnamed):
        others = ", ".join(known[len([name for name in unnamed if name in known]) :])
        return f": too many values are without a name; give {f'by name {others}' if others else 'fewer'}."
    if twice := [name for name in unnamed[: len(given)] if name in named]:
        return f": {twice[0]} is given twice; give it once."
    missing = [p.name for p in parameters[len(given) :] if p.default is p.empty and p.name not in named]
    return f": {missing[0]} is missing; give {missing[0]} = a value." if missing else ""


def _is_of(value: Any, kind: Any) -> bool:
    """Whether a value is of a kind, by its class alone; a number of NumPy is one of Python."""
    origin = typing.get_origin(kind)
    if origin in (typing.Union, types.UnionType):
        return any(_is_of(value, inner) for inner in typing.get_args(kind))
    if kind in (float, int, bool):
        value = as_plain(value)
        return isinstance(value, int | float if kind is float else kind) and isinstance(value, bool) == (kind is bool)
    if origin is typing.Literal:
        return value in typing.get_args(kind)
    if kind in (Any, np.ndarray) or origin is np.ndarray:  # what is made an array is looked at there
        return True
    if origin is not None and origin is not Annotated:
        lists = origin in (collections.abc.Sequence, collections.abc.Iterable)
        return isinstance(value, origin) and not (lists and isinstance(value, str))
    return value is None if kind in (None, type(None)) else not isinstance(kind, type) or isinstance(value, kind)


def _kinds_in_words(kind: Any) -> list[str]:
    """What is of a kind, in words."""
    origin = typing.get_origin(kind) or kind
    if origin in (typing.Union, types.UnionType):
        inner = typing.get_args(kind)
        paths = any(typing.get_origin(k) is os.PathLike for k in inner)
        return [w for k in inner if not (paths and k is str) for w in _kinds_in_words(k)]
    if origin is typing.Literal:
        return list(map(repr, typing.get_args(kind)))
    name = getattr(origin, "__name__", "")
    return [WORDS.get(name) or f"a {name}{MAKERS.get(name, '')}"]


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
    class_names = [k.__name__ for k in (kind, *inner, *itertools.chain.from_iterable(map(typing.get_args, inner)))
             if isinstance(k, type) and issubclass(k, msgspec.Struct)]  # fmt: skip
    return " or ".join(class_names) if class_names else "a mapping"


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
    inside, item = path.rstrip("`"), value
    for index in re.findall(r"\[(\d+)\]", inside):
        item = item[int(index)]
    if inside.endswith("[...]"):  # of a table of lists, without its key
        key, item = next(((key, part) for key, part in item.items() if not isinstance(part, list)), ("", item))
        inside = inside.replace("[...]", f".{key}")
    if said.startswith("Invalid enum value"):
        choices = _choices(kind)
        if removed and item in removed:
            return f"{inside} = {item!r} was removed; give {removed[item]!r}."
        if isinstance(item, str):
            return f"{inside} = {item!r} is not possible; {suggestion(item, map(str, choices))}"
        return f"{inside} = {item!r} is not possible; choose from {', '.join(map(repr, choices))}."
    if bound := re.match(r"Expected `\w+` ([<>]=?) (\S+)", said):
        zero = {">": "a positive number", ">=": "zero or a positive number"} if float(bound[2]) == 0 else {}
        limit = zero.get(bound[1], f"{SIDES[bound[1]]} {float(bound[2]):g}")
        return f"{inside} = {_short(item)} is not possible; give {limit}."
    match = re.match(r"Expected `([^`]+)`(?: of length (?:at least )?(\d+))?", said)
    if not match:
        return f"{inside} = {_short(item)} is not possible ({said[:1].lower()}{said[1:]}); correct it."
    if match[2]:
        return f"{inside} has {len(item)} values; give {match[2]}."
    expected = " or ".join(words.get(name, name) for name in match[1].split(" | "))
    return f"{inside} = {_short(item)} is {word_for(item)}; give {expected}."


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
    words = {bool: "true or false", int: "a whole number", float: "a number with decimals", str: "text"}
    words |= {list: "a list", dict: "a table", type: "a class"}
    found = (word for kind, word in words.items() if isinstance(value, kind))
    return next(found, f"a {type(value).__name__}")


def suggestion(word: str, known: Iterable[str]) -> str:
    """ "did you mean X?", or all known words if none is similar."""
    import difflib

    known = list(known)
    near = difflib.get_close_matches(str(word).lower(), known, n=1, cutoff=0.55)
    return f"did you mean {near[0]}?" if near else f"choose from {', '.join(known)}."


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 else f"{text[:37]}..."


def _choices(kind: Any) -> list[Any]:
    """All literal values inside a type."""
    if typing.get_origin(kind) is typing.Literal:
        return list(typing.get_args(kind))
    return list(dict.fromkeys(itertools.chain.from_iterable(map(_choices, typing.get_args(kind)))))
