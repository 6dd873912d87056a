"""Programs from elsewhere: found by file, module or entry point, bound by name, and held to what they hand back.

A third party's backend is a mapping from operations' names to Python functions. A function names those of the
operation's arguments that it wants, and either writes the outputs in place or returns them. refsim's own backends are
there under their own names, so that one door leads to all programs.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
import importlib.util
import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from refsim.contract.ladder import STEPS, Outcome, ProgramFailed, Target, climbing
from refsim.errors import InputError
from refsim.operation import BACKENDS, REGISTRY, Operation

GROUP = "refsim.contract"  # of entry points
ATTRIBUTE = "PROGRAMS"  # what is taken from a module where nothing else is named
DTYPES = ("float32", "float64")
ARRAYS = ("cpu", "cuda")

Program = Callable[..., Any]


@dataclass(frozen=True)
class Programs:
    """A backend under test.

    programs  {operation's name: function of arguments by name}; None stands for refsim's own
    arrays    whose arrays and lists the functions take: "cpu" (NumPy arrays, rows) or "cuda" (device arrays, columns)
    dtypes    in which they compute, "float32" and "float64"
    name      in messages and reports
    """

    programs: Mapping[str, Program] | None = field(default_factory=dict)
    arrays: str = "cpu"
    dtypes: tuple[str, ...] = DTYPES
    name: str = "the backend"

    def checked(self) -> Programs:
        """The same; InputError for names that mean nothing."""
        if self.arrays not in (ARRAYS if self.programs is not None else BACKENDS):
            raise InputError(f"{self.name}: there are no arrays of {self.arrays!r}; take one of {', '.join(ARRAYS)}.")
        _among(self.dtypes, DTYPES, f"{self.name}: there is no dtype")
        for name, program in (self.programs or {}).items():
            _operation(name, self.name)
            if not callable(program):
                raise InputError(f"{self.name}: its program for {name} is {program!r}; give a function.")
        return self

    def operations(self, wanted: Sequence[str] = ()) -> tuple[str, ...]:
        """Names of what is judged: those wanted, or all that there are. InputError for one that is missing."""
        offered = tuple(REGISTRY) if self.programs is None else tuple(self.programs)
        for name in wanted:
            _operation(name, "the contract")
            if name not in offered:
                there = ", ".join(offered) or "no operation"
                raise InputError(f"{self.name} has no program for {name}; it has programs for {there}.")
        if not offered:
            raise InputError(f"{self.name} has no program for any operation; `refsim list` names the operations.")
        return tuple(wanted) or offered

    def loader(self) -> Callable[[Operation], Program] | None:
        """What a Target takes: operation -> program on all its arguments in their order; None for refsim's own."""
        if self.programs is None:
            return None
        return lambda operation: by_name(self.programs[operation.name], operation, self)


def own(backend: str) -> Programs:
    """refsim's own programs on `backend`."""
    return Programs(None, backend, DTYPES, f"refsim on {backend}")


def load(source: str) -> Programs:
    """The backend that `source` names.

    source  "cpu", "cuda" or "numpy" (refsim's own), the name of an entry point of the group "refsim.contract", a file
            "folder/file.py" or a module "package.module"; after a colon the name of the mapping in it (PROGRAMS)

    Raises InputError where it cannot be imported or is no mapping from names of operations to functions.
    """
    if source in BACKENDS:
        return own(source)
    entries = [e for e in importlib.metadata.entry_points(group=GROUP) if e.name == source]
    place, _, attribute = source.rpartition(":") if ":" in source else (source, "", "")
    try:
        if entries:
            found = entries[0].load()
        elif place.endswith(".py"):
            found = _from_file(Path(place))
        else:
            found = importlib.import_module(place)
    except InputError:
        raise
    except Exception as error:  # a module may raise whatever it likes
        if isinstance(error, ModuleNotFoundError) and not entries and (error.name or "") in _parents(place):
            hint = "give a file (folder/file.py), a module that Python can import, or an entry point's name"
            near = difflib.get_close_matches(place, REGISTRY, 1)
            meant = f" (or did you mean the operation {near[0]}?)" if near else ""
            raise InputError(
                f"There is no module {place!r} and no such entry point of {GROUP}; {hint}{meant}."
            ) from None
        raise InputError(f"{source} cannot be imported: {type(error).__name__}: {_line(error)}.") from None
    if inspect.ismodule(found):
        wanted = attribute or ATTRIBUTE
        if not hasattr(found, wanted):
            raise InputError(f"{place} has no {wanted}; write {wanted} = {{'sph.density': function}} in it.")
        found = getattr(found, wanted)
    if isinstance(found, Programs):
        return replace(found, name=source).checked()
    if isinstance(found, Mapping):
        return Programs(found, name=source).checked()
    raise InputError(f"{source} is {type(found).__name__}; give a mapping from names of operations to functions.")


def _from_file(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f"there is no file {path}; give the path of a Python file.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None:
        raise InputError(f"{path} is no Python file; give one whose name ends in .py.")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _parents(module: str) -> set[str]:
    parts = module.split(".")
    return {".".join(parts[: k + 1]) for k in range(len(parts))}


def _operation(name: str, owner: str) -> Operation:
    if name not in REGISTRY:
        from refsim.scene_file import suggestion

        raise InputError(f"{owner} knows no operation {name!r}; {suggestion(name, REGISTRY)}")
    return REGISTRY[name]


def _among(values: Sequence[str], known: Sequence[str], words: str) -> None:
    for value in values:
        if value not in known:
            raise InputError(f"{words} {value!r}; choose from {', '.join(known)}.")


def _line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    return text.rstrip(".") or "no word of why"


def by_name(program: Program, operation: Operation, owner: Programs) -> Program:
    """The program as a function of all the operation's arguments, in their order.

    Raises InputError, when it is called, for what it hands back in a wrong shape or dtype, and ProgramFailed for what
    it raises; at once for a parameter that the operation has not.
    """
    names = operation.arguments(owner.arrays)
    label = f"{owner.name}: its program for {operation.name}"
    ordered, named = _parameters(program, names, label)

    def call(*values: Any) -> None:
        given = dict(zip(names, values))
        try:
            returned = program(*[given[n] for n in ordered], **{n: given[n] for n in named})
        except Exception as error:
            raise ProgramFailed(f"it raised {type(error).__name__}: {_line(error)}") from error
        if returned is not None:
            _hand_over(returned, operation, given, owner.arrays, label)

    return call


def _parameters(program: Program, names: Sequence[str], label: str) -> tuple[list[str], list[str]]:
    """(positional, keyword) arguments that the program asks for."""
    try:
        parameters = inspect.signature(getattr(program, "py_func", program)).parameters.values()
    except (TypeError, ValueError):
        raise InputError(f"{label} does not tell its parameters; wrap it in a Python function with names.") from None
    ordered, named = [], []
    for p in parameters:
        if p.kind is p.VAR_KEYWORD:
            named += [n for n in names if n not in ordered and n not in named]
        elif p.name in names:
            (named if p.kind is p.KEYWORD_ONLY else ordered).append(p.name)
        elif p.kind is p.VAR_POSITIONAL or p.default is p.empty:
            star = "*" if p.kind is p.VAR_POSITIONAL else ""
            raise InputError(f"{label} takes {star}{p.name}, which the operation has not; it has {', '.join(names)}.")
        elif p.kind is not p.KEYWORD_ONLY:
            break  # what stands behind it keeps its default, too
    return ordered, named


def _hand_over(returned: Any, operation: Operation, given: Mapping[str, Any], arrays: str, label: str) -> None:
    """Write what a program returned into the outputs."""
    if arrays == "cuda":
        raise InputError(f"{label} returned something; on device arrays write the outputs in place and return None.")
    wanted = {name: given[name] for name in operation.outputs if given[name] is not None}
    if not isinstance(returned, Mapping):
        if len(operation.outputs) > 1:
            kind = type(returned).__name__
            raise InputError(f"{label} returned {kind}; return {{name: array}} for {_names(wanted)}.")
        returned = {operation.outputs[0]: returned}
    for name in returned:
        if name not in operation.outputs:
            raise InputError(f"{label} returned {name!r}, which is no output; those are {_names(operation.outputs)}.")
    for name, target in wanted.items():
        if name not in returned:
            raise InputError(f"{label} did not return {name}; return it, or write all outputs in place.")
        values = returned[name]
        if not isinstance(values, np.ndarray):
            raise InputError(f"{label} returned {name} as {type(values).__name__}; return a NumPy array.")
        if values.shape != target.shape or values.dtype != target.dtype:
            raise InputError(
                f"{label} returned {name} as {values.dtype} of shape {values.shape}; wanted is {target.dtype} of shape"
                f" {target.shape}."
            )
        if name in operation.adds:
            target += values
        else:
            target[...] = values


def _names(names: Sequence[str] | Mapping[str, Any]) -> str:
    return ", ".join(names)


def trials(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
    begin: Callable[[str, int, str], None] = lambda dtype, variant, step: None,
) -> Iterator[Outcome]:
    """Outcomes of the ladder for one operation as they come; all dtypes of the backend, variants and steps by default.

    begin  is told of (dtype, variant, step) before each step

    Raises InputError for what does not exist or cannot run here, and for a wrong shape or dtype.
    """
    found = REGISTRY[programs.operations((operation,))[0]]
    _among(dtypes, programs.dtypes, f"{programs.name} does not compute in")
    _among(steps, tuple(STEPS), "there is no step")
    every = range(len(found.variants))
    chosen = [n for n in (variants or every) if n in every]
    if variants and not chosen:
        raise InputError(f"{operation} has no variant {', '.join(map(str, variants))}; it has 0 to {every[-1]}.")
    loader = programs.loader()
    for dtype in dtypes or programs.dtypes:
        for variant in chosen:
            yield from climbing(Target(found, programs.arrays, dtype, variant, loader), tuple(steps) or None, begin)
