"""External programs: found by file, module or entry point, bound by name; what they return is checked.

A third party's backend is a mapping from operations' names to Python functions. A function names those of the
operation's arguments that it wants, and either writes the outputs in place or returns them. refsim's own backends are
there under their own names, so that all programs are loaded by one function.
"""

from __future__ import annotations

import difflib
import importlib
import importlib.metadata
import importlib.util
import inspect
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from refsim.contract.arrays import converted, to_numpy
from refsim.contract.inputs import Inputs, backend_for
from refsim.contract.ladder import STEPS, Outcome, ProgramFailed, Target, Trial, performed, planned
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, REGISTRY, Operation, backend_of
from refsim.smoothing import SHAPES, Smoothing

GROUP = "refsim.contract"  # of entry points
ATTRIBUTE = "PROGRAMS"  # what is taken from a module where nothing else is named
DTYPES = ("float32", "float64")
ARRAYS = ("cpu", "cuda")
DIMS = (2, 3)
MOST_TOLD = 300  # characters of a message from an external program

Program = Callable[..., Any]


@dataclass(frozen=True)
class Programs:
    """A backend under test. What it is declared not to support is not judged, and reported as not judged.

    programs  {operation's name: function of arguments by name}; None stands for refsim's own
    arrays    whose arrays and lists the functions take: "cpu" (NumPy arrays, rows) or "cuda" (device arrays, columns)
    dtypes    in which they compute, "float32" and "float64"
    name      in messages and reports
    kernels   smoothing kernels that they know, of refsim.smoothing.SHAPES
    dims      dimensions in which they compute, 2 and 3
    walls     whether they take wall particles
    without   optional arguments that they do not take or write
    convert   applied to each array before a function gets it: `cupy.asarray`, `torch.from_dlpack`, ...; it must share
              the memory, or the functions return their outputs
    """

    programs: Mapping[str, Program] | None = field(default_factory=dict)
    arrays: str = "cpu"
    dtypes: tuple[str, ...] = DTYPES
    name: str = "the backend"
    kernels: tuple[str, ...] = tuple(SHAPES)
    dims: tuple[int, ...] = DIMS
    walls: bool = True
    without: tuple[str, ...] = ()
    convert: Callable[[Any], Any] | None = None

    def checked(self) -> Programs:
        """The same; InputError for names that mean nothing."""
        if self.arrays not in (ARRAYS if self.programs is not None else BACKENDS):
            raise InputError(f"{self.name}: there are no arrays of {self.arrays!r}; take one of {', '.join(ARRAYS)}.")
        for field_name in ("dtypes", "kernels", "dims", "without"):
            value = getattr(self, field_name)
            if isinstance(value, str) or not isinstance(value, Sequence):
                raise InputError(f"{self.name}: {field_name} = {value!r} is no sequence; write ({value!r},).")
        _among(self.dtypes, DTYPES, f"{self.name}: there is no dtype")
        _among(self.kernels, tuple(SHAPES), f"{self.name}: there is no smoothing kernel")
        _among(self.dims, DIMS, f"{self.name}: there is no dimension")
        optional = {name for operation in REGISTRY.values() for name in operation.optional}
        _among(self.without, sorted(optional), f"{self.name}: there is no optional argument")
        if self.convert is not None and not callable(self.convert):
            raise InputError(f"{self.name}: convert = {self.convert!r} is no function; give one of an array.")
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

    def unsupported(self, operation: Operation, variant: Mapping[str, Any]) -> str:
        """What a variant has that the backend is declared not to support, as a clause; "" if there is no such thing."""
        given = (*operation.arguments("numpy"), *operation.outputs)
        for name in self.left_out:
            if name in given and variant.get(name, name) is not None:
                return f"with {name}"
        return ""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Arguments that are not judged unless they are None."""
        return (*self.without, *(() if self.walls else ("walls",)))

    def excludes(self, operation: Operation, inputs: Inputs) -> str:
        """What of the inputs the backend is declared not to support, as a clause; "" if it supports all."""
        if inputs.case.dim not in self.dims:
            return f"in {inputs.case.dim} dimensions"
        names = {number: name for name, number in SHAPES.items()}
        for name in operation.arguments("numpy"):
            value = inputs[name] if name in ("smoothing", "gradient_smoothing") else None
            if isinstance(value, Smoothing):
                kernel = names[int(value.shape)]
                if kernel not in self.kernels:
                    return f"with the kernel {kernel}"
                if int(value.dim) not in self.dims:
                    return f"in {int(value.dim)} dimensions"
        return ""

    def loader(self) -> Callable[[Operation], Program] | None:
        """What a Target takes: operation -> program on all its arguments in their order; None for refsim's own."""
        if self.programs is None:
            return None
        programs = self.programs
        return lambda operation: by_name(programs[operation.name], operation, self)


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
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:  # a module may raise whatever it likes, SystemExit too
        if isinstance(error, ModuleNotFoundError) and not entries and (error.name or "") in _parents(place):
            hint = "give a file (folder/file.py), a module that Python can import, or an entry point's name"
            near = difflib.get_close_matches(place, REGISTRY, 1)
            meant = f" (or did you mean the operation {near[0]}?)" if near else ""
            raise InputError(
                f"There is no module {place!r} and no such entry point of {GROUP}; {hint}{meant}."
            ) from None
        raise InputError(f"{source} cannot be imported: {told(error)}.") from None
    try:
        return _programs(found, source, place, attribute)
    except InputError:
        raise
    except Exception as error:  # so may a mapping of its own kind
        raise InputError(f"{source} offers no usable programs: {told(error)}.") from None


def programs_of(module: Any) -> Programs:
    """The programs of an imported module: its PROGRAMS. Raises InputError if there are none that can be used."""
    return _programs(module, module.__name__, module.__name__, "")


def _programs(found: Any, source: str, place: str, attribute: str) -> Programs:
    """The mapping behind an imported object."""
    if inspect.ismodule(found):
        wanted = attribute or ATTRIBUTE
        if not hasattr(found, wanted):
            raise InputError(f"{place} has no {wanted}; write {wanted} = {{'sph.density': function}} in it.")
        found = getattr(found, wanted)
    if isinstance(found, Programs):
        return replace(found, name=source).checked()
    if isinstance(found, Mapping):
        return Programs(dict(found), name=source).checked()
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
        from refsim.core.checked import suggestion

        raise InputError(f"{owner}: {name!r} is not an operation; {suggestion(name, REGISTRY)}")
    return REGISTRY[name]


def _among(values: Sequence[Any], known: Sequence[Any], words: str) -> None:
    for value in values:
        if value not in known:
            raise InputError(f"{words} {value!r}; choose from {', '.join(map(str, known))}.")


def told(error: BaseException, how: str = "") -> str:
    """An exception of another's code on one line of printable characters."""
    try:
        text = str(error)[:MOST_TOLD]
    except Exception:  # its own __str__ raises
        text = ""
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split()).rstrip(".")
    return f"{how} {type(error).__name__}: {text or 'no message'}".strip()


def by_name(program: Program, operation: Operation, owner: Programs) -> Program:
    """The program as a function of all the operation's arguments, in their order.

    Raises ProgramFailed, when it is called, for what it raises and for an answer of a wrong shape or dtype; at once
    InputError for a parameter that the operation has not.
    """
    names = operation.arguments(owner.arrays)
    label = f"{owner.name}: its program for {operation.name}"
    ordered, named = _parameters(program, names, label)

    def call(*values: Any) -> None:
        given = dict(zip(names, values))
        try:
            if owner.convert is not None:
                taken = converted(given, {*ordered, *named}, owner.convert)
            else:
                taken = given
            returned = program(*[taken[n] for n in ordered], **{n: taken[n] for n in named})
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # SystemExit is a failure of the program, and no end of the ladder
            raise ProgramFailed(told(error, "it raised")) from error
        try:
            if returned is not None:
                _hand_over(returned, operation, given, owner.arrays)
        except ProgramFailed:
            raise
        except Exception as error:  # an object of its own kind
            raise ProgramFailed(told(error, "its answer raised")) from error

    return call


def _parameters(program: Program, names: Sequence[str], label: str) -> tuple[list[str], list[str]]:
    """(positional, keyword) arguments that the program takes."""
    try:
        parameters = inspect.signature(getattr(program, "py_func", program)).parameters.values()
    except (TypeError, ValueError):
        raise InputError(f"{label} does not state its parameters; wrap it in a Python function with names.") from None
    ordered: list[str] = []
    named: list[str] = []
    for p in parameters:
        if p.kind is p.VAR_KEYWORD:
            named += [n for n in names if n not in ordered and n not in named]
        elif p.name in names:
            (named if p.kind is p.KEYWORD_ONLY else ordered).append(p.name)
        elif p.kind is p.VAR_POSITIONAL or p.default is p.empty:
            star = "*" if p.kind is p.VAR_POSITIONAL else ""
            known = ", ".join(names)
            raise InputError(f"{label} takes {star}{p.name}, which the operation does not have; it has {known}.")
        elif p.kind is not p.KEYWORD_ONLY:
            break  # what stands behind it keeps its default, too
    return ordered, named


def _hand_over(returned: Any, operation: Operation, given: Mapping[str, Any], arrays: str) -> None:
    """Write what a program returned into the outputs; ProgramFailed if it does not fit."""
    wanted = {name: given[name] for name in operation.outputs if given[name] is not None}
    if not isinstance(returned, Mapping):
        if len(operation.outputs) > 1:
            raise ProgramFailed(
                f"it returned {type(returned).__name__}; wanted is {{name: array}} for {_names(wanted)}"
            )
        returned = {operation.outputs[0]: returned}
    for name in returned:
        if name not in operation.outputs:
            raise ProgramFailed(f"it returned {name!r}, which is no output; those are {_names(operation.outputs)}")
    for name, target in wanted.items():
        if name not in returned:
            raise ProgramFailed(f"it did not return {name}; it must, or write all outputs in place")
        values = to_numpy(returned[name])
        if values is None:
            kind = type(returned[name]).__name__
            raise ProgramFailed(
                f"it returned {name} as {kind}; wanted is a NumPy array, or one with __dlpack__ or"
                " __cuda_array_interface__"
            )
        if values.shape != target.shape or values.dtype != target.dtype:
            raise ProgramFailed(
                f"it returned {name} as {values.dtype} of shape {values.shape}; wanted is {target.dtype} of shape"
                f" {target.shape}"
            )
        if arrays == "cuda":
            target.copy_to_device(target.copy_to_host() + values if name in operation.adds else values)
        elif name in operation.adds:
            target += values
        else:
            target[...] = values


def _names(names: Sequence[str] | Mapping[str, Any]) -> str:
    return ", ".join(names)


def check_names(
    operations: Sequence[str] = (), dtypes: Sequence[str] = (), variants: Sequence[int] = (), steps: Sequence[str] = ()
) -> None:
    """Raise InputError for a name or number that no library has; needs no library."""
    for name in operations:
        _operation(name, "the contract")
    _among(dtypes, DTYPES, "there is no dtype")
    _among(steps, tuple(STEPS), "there is no step")
    for name in operations or (() if not variants else (max(REGISTRY, key=lambda n: len(REGISTRY[n].variants)),)):
        _variants(REGISTRY[name], variants)


def _variants(operation: Operation, variants: Sequence[int]) -> list[int]:
    """Those of `variants` that the operation has, all by default; InputError if it has none of them."""
    every = range(len(operation.variants))
    chosen = [n for n in (variants or every) if n in every]
    if not chosen:
        wanted = ", ".join(map(str, variants))
        raise InputError(f"{operation.name} has no variant {wanted}; it has 0 to {every[-1]}.")
    return chosen


def checked_request(programs: Programs, request: Any) -> tuple[str, ...]:
    """Names of the operations to judge; InputError if the programs or this machine cannot do what is requested."""
    names = programs.operations(request.operations)
    _among(request.dtypes, programs.dtypes, f"{programs.name} does not compute in")
    backend_for(programs.arrays)
    for name in names:
        _variants(REGISTRY[name], request.variants)
        if programs.programs is not None:
            by_name(programs.programs[name], REGISTRY[name], programs)
    return names


@dataclass(frozen=True)
class Step:
    """One trial of the ladder of one operation, in the order in which they are climbed.

    number      of the trial in the operation's ladder
    trial       None for what is not judged as a whole: a dtype, a variant
    not_judged  why
    """

    number: int
    target: Target
    trial: Trial | None
    not_judged: str = ""

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.trial.name if self.trial else "every trial"

    @property
    def step(self) -> str:
        """Name of the step, "-" for all."""
        return self.trial.step if self.trial else "-"

    def outcome(self, error: float = 0.0, words: str = "") -> Outcome:
        """An outcome of this trial that did not pass."""
        target = self.target
        return Outcome(
            target.operation.name, self.step, self.name, target.backend, target.dtype, target.variant, False, error,
            words, self.not_judged,
        )  # fmt: skip

    def perform(self) -> Outcome | None:
        """Call the program and judge; None where the trial does not apply."""
        return performed(self.target, self.trial) if self.trial else self.outcome()


def ladder(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
    calling: Callable[[str | None], None] = lambda case: None,
) -> Iterator[Step]:
    """The trials of one operation, in order; no program is called before `perform`.

    calling  is told the case's name before each call of the program, and None after it

    All dtypes, variants and steps by default. Raises InputError for what does not exist or cannot run here.
    """
    found = REGISTRY[programs.operations((operation,))[0]]
    _among(dtypes, programs.dtypes, f"{programs.name} does not compute in")
    _among(steps, tuple(STEPS), "there is no step")
    _variants(found, variants)
    names = [programs.arrays]
    if programs.programs is None:
        names = [name for name in found.names() if backend_of(name) == programs.arrays]
    target = Target(found, names[0], loader=programs.loader(), calling=calling, excludes=programs.excludes)
    counter = itertools.count()
    for name in names:
        for dtype in dtypes or DTYPES:
            for variant, overrides in enumerate(found.as_computed_by(name).variants):
                if variants and variant not in variants:
                    continue
                at = replace(target, operation=found, backend=name, dtype=dtype, variant=variant, faults=[])
                reason = dtype if dtype not in programs.dtypes else programs.unsupported(found, overrides)
                if reason:
                    yield Step(next(counter), at, None, reason)
                    continue
                for trial in planned(at, tuple(steps) or None):
                    yield Step(next(counter), at, trial)


def trials(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
) -> Iterator[Outcome]:
    """Outcomes of the ladder for one operation as they come; all dtypes of the backend, variants and steps by default.

    Raises InputError for what does not exist or cannot run here.
    """
    for step in ladder(programs, operation, dtypes or programs.dtypes, variants, steps):
        outcome = step.perform()
        if outcome is not None:
            yield outcome
