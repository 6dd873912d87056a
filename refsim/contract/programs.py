"""External programs: found by file, module or entry point; what they are declared to support; their ladder.

A third party's backend is a mapping from operations' names to Python functions. A function names those of the
operation's arguments that it wants, and either writes the outputs in place or returns them. refsim's own backends are
there under their own names, so that all programs are loaded by one function.
"""

import difflib
import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import itertools
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from refsim.contract.answers import closed_forms, extended, hard_inputs, large_case, on_case, parameters, usual_value
from refsim.contract.binding import by_name, error_line
from refsim.contract.drawn import drawn_inputs
from refsim.contract.inputs import KERNELS, Inputs, backend_for, groups_of, shape_acts
from refsim.contract.properties import additivity, bad_input, invariants, repeats, symmetries
from refsim.contract.target import NotJudged, Outcome, Sought, Target, Trial
from refsim.core import cases
from refsim.core.checked import Checked, Count
from refsim.core.errors import InputError
from refsim.core.operation import BACKENDS, REGISTRY, CaseValue, Operation, backend_of
from refsim.smoothing import SHAPES

GROUP = "refsim.contract"  # of entry points
ATTRIBUTE = "PROGRAMS"  # what is taken from a module where nothing else is named
DTYPES: Any = ("float32", "float64")
ARRAYS = ("cpu", "cuda")

AS_PRINTED = "a reading as printed"

Program = Callable[..., Any]
Names = Sequence[str]
Numbers = Sequence[int]
Seed = int | str | None


class Programs(Checked, frozen=True, kw_only=False):
    """A backend under test. What it is declared not to support is not judged, and reported as not judged.

    programs  {operation's name: function of arguments by name}; None stands for refsim's own
    arrays    whose arrays and lists the functions take: "cpu" (NumPy arrays, rows) or "cuda" (device arrays, columns)
    dtypes    in which they compute, "float32" and "float64"
    name      in messages and reports
    kernels   smoothing kernels that they know, of refsim.smoothing.SHAPES
    dims      dimensions in which they compute, 2 and 3
    walls     whether they take wall particles
    without   optional arguments that they do not take or write
    readings  whether they take parameters that stand for misprints and for readings of a paper beside the adopted one
    same_bits whether they give the same bits in every call; without it sums may be taken in any order
    most_particles  of a call; None: of any number
    convert   applied to each array before a function gets it: `cupy.asarray`, `torch.from_dlpack`, ...; it must share
              the memory, or the functions return their outputs
    """

    programs: Any = msgspec.field(default_factory=dict)
    arrays: Literal["numpy", "cpu", "cuda"] = "cpu"
    dtypes: tuple[Literal["float32", "float64"], ...] = DTYPES
    name: str = "the backend"
    kernels: tuple[str, ...] = tuple(SHAPES)
    dims: tuple[Literal[2, 3], ...] = (2, 3)
    walls: bool = True
    without: tuple[str, ...] = ()
    readings: bool = True
    same_bits: bool = True
    most_particles: Count | None = None
    convert: Any = None

    def checked(self) -> "Programs":
        """The same; InputError for names that mean nothing."""
        if self.programs is not None:
            among((self.arrays,), ARRAYS, f"{self.name}: there are no arrays of")
        among(self.kernels, tuple(SHAPES), f"{self.name}: there is no smoothing kernel")
        optional = sorted({name for operation in REGISTRY.values() for name in operation.optional})
        among(self.without, optional, f"{self.name}: there is no optional argument")
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
        printed = [v for v in variant.values() if isinstance(v, CaseValue) and v.function == "as_printed"]
        return AS_PRINTED if printed and not self.readings else ""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Arguments that are not judged unless they are None."""
        cases.discover()
        as_printed = () if self.readings else (name for name, members in cases.READINGS.items() if not members)
        return (*self.without, *(() if self.walls else ("walls",)), *as_printed)

    def excludes(self, operation: Operation, inputs: Inputs) -> str:
        """What of the inputs the backend is declared not to support, as a clause; "" if it supports all."""
        if self.most_particles is not None and inputs.case.count > self.most_particles:
            return f"above {self.most_particles:,} particles"
        if inputs.case.dim not in self.dims:
            return f"in {inputs.case.dim} dimensions"
        if not self.readings:
            groups = groups_of(operation, inputs).items()
            readings = ((group, member, name) for name, group in groups for member in cases.READINGS.get(name, ()))
            others = (getattr(g, m) != getattr(usual_value(name, inputs.dtype), m) for g, m, name in readings)
            if inputs.case.literal or any(others):
                return AS_PRINTED
        names = {number: name for name, number in SHAPES.items()}
        for name in (n for n in KERNELS if n in operation.arguments("numpy")):
            kernel = names[int(inputs[name].shape)]
            if kernel not in self.kernels and name in shape_acts(operation):
                return f"with the kernel {kernel}"
            if int(inputs[name].dim) not in self.dims:
                return f"in {int(inputs[name].dim)} dimensions"
        return ""

    def ladders(self, operation: Operation) -> tuple[str, ...]:
        """Kernels with which the ladder is climbed: "" as the cases have them, else one, or one of values and one of
        gradients where the operation takes both.
        """
        if self.programs is None or not any(n in operation.arguments("numpy") for n in KERNELS):
            return ("",)
        acting = shape_acts(operation)
        both = (" ".join(self.kernels[:2]),) if len(acting) == 2 and len(self.kernels) > 1 else ()
        return (*self.kernels, *both) if acting else self.kernels[:1]

    def bound(self, operation: Operation) -> Program:
        """The program of an operation, on all its arguments in their order."""
        return by_name(self.programs[operation.name], operation, self.name, self.arrays, self.convert)

    def operation(self, name: str) -> Operation:
        """The operation as it is judged: other programs than refsim's also with each feature by itself."""
        return REGISTRY[name] if self.programs is None else extended(name)


def refsim_programs(backend: Any) -> Programs:
    """refsim's own programs on `backend`."""
    return Programs(None, backend, DTYPES, f"refsim on {backend}")


def load(source: str) -> Programs:
    """The backend that `source` names.

    source  "cpu", "cuda" or "numpy" (refsim's own), the name of an entry point of the group "refsim.contract", a file
            "folder/file.py" or a module "package.module"; after a colon the name of the mapping in it (PROGRAMS)

    Raises InputError where it cannot be imported or is no mapping from names of operations to functions.
    """
    if source in BACKENDS:
        return refsim_programs(source)
    place, _, attribute = source.rpartition(":") if ":" in source else (source, "", "")
    file, how = place.endswith(".py"), "cannot be imported"
    entries = () if file else importlib.metadata.entry_points(group=GROUP, name=source)
    try:
        if file:
            module = _from_file(Path(place))
        elif entries:
            module = next(iter(entries)).load()
        else:
            module = importlib.import_module(place)
        how = "offers no usable programs"  # as a mapping of its own kind may
        return programs_of(module, source, place, attribute)
    except (InputError, KeyboardInterrupt):
        raise
    except BaseException as error:  # a module may raise whatever it likes, SystemExit too
        if isinstance(error, ModuleNotFoundError) and not entries and f"{place}.".startswith(f"{error.name}."):
            hint = "give a file (folder/file.py), a module that Python can import, or an entry point's name"
            raise InputError(f"There is no module {place!r} and no such entry point of {GROUP}; {hint}.") from None
        raise InputError(f"{source} {how}: {error_line(error)}.") from None


def programs_of(value: Any, source: str, place: str = "", attribute: str = "") -> Programs:
    """The programs of an imported object: of a module its PROGRAMS. Raises InputError if none can be used."""
    if inspect.ismodule(value):
        wanted = attribute or ATTRIBUTE
        if not hasattr(value, wanted):
            raise InputError(f"{place or source} has no {wanted}; write {wanted} = {{'sph.density': function}} in it.")
        value = getattr(value, wanted)
    if isinstance(value, Programs):
        return msgspec.structs.replace(value, name=source).checked()
    if isinstance(value, Mapping):
        return Programs(dict(value), name=source).checked()
    raise InputError(f"{source} is {type(value).__name__}; give a mapping from names of operations to functions.")


def _from_file(path: Path) -> Any:
    if not path.is_file():
        raise InputError(f"there is no file {path}; give the path of a Python file.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec
    assert spec.loader  # of a name that ends in .py
    module = importlib.util.module_from_spec(spec)
    if (folder := str(path.parent.resolve())) not in sys.path:
        sys.path.insert(0, folder)  # so that it may import its neighbours
    spec.loader.exec_module(module)
    return module


def _operation(name: str, owner: str) -> Operation:
    if name not in REGISTRY:
        near = difflib.get_close_matches(name, REGISTRY, 1, 0.55)
        hint = f"did you mean {near[0]}?" if near else "`refsim list` has them all."
        raise InputError(f"{owner}: {name!r} is not an operation; {hint}")
    return REGISTRY[name]


def among(values: Sequence[Any], known: Sequence[Any], words: str) -> None:
    """Raise InputError, beginning with `words`, for a value that is not known."""
    for value in values:
        if value not in known:
            raise InputError(f"{words} {value!r}; choose from {', '.join(map(str, known))}.")


def check_names(operations: Names = (), dtypes: Names = (), variants: Numbers = (), steps: Names = ()) -> None:
    """Raise InputError for a name or number that no library has; needs no library."""
    for name in operations:
        _operation(name, "the contract")
    among(dtypes, DTYPES, "there is no dtype")
    among(steps, tuple(STEPS), "there is no step")
    most = max(len(operation.variants) + len(operation.optional) for operation in REGISTRY.values())
    among(variants, range(most), "there is no variant")
    for name in operations if variants else ():
        chosen_variants(extended(name), variants)


def chosen_variants(operation: Operation, variants: Sequence[int]) -> list[int]:
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
    among(request.dtypes, programs.dtypes, f"{programs.name} does not compute in")
    backend_for(programs.arrays)
    for name in names:
        chosen_variants(programs.operation(name), request.variants)
        if programs.programs is not None:
            programs.bound(REGISTRY[name])
    return names


# The ladder of one operation: its trials in order, for each dtype, variant and kernel


@dataclass(frozen=True)
class Step:
    """One trial of the ladder of one operation, in the order in which they are climbed."""

    number: int  # of the trial in the operation's ladder
    target: Target
    step: str = "-"  # its step's name, "-" for all
    trial: Trial | None = None  # None for what is not judged as a whole: a dtype, a variant
    not_judged: str = ""  # why

    @property
    def name(self) -> str:
        """Name of the trial."""
        return self.trial.name if self.trial else "every trial"

    def outcome(self, not_judged: str = "", words: str = "") -> Outcome:
        """An outcome of this trial that did not pass."""
        made = self.target.outcome(0.0, words)
        return replace(made, step=self.step, trial=self.name, passed=False, not_judged=not_judged or self.not_judged)

    def perform(self) -> Outcome | None:
        """Call the program and judge; None where the trial does not apply.

        It fails where the program raises, changes an input, writes beside its arrays or leaves an output unset.
        """
        if self.trial is None:
            return self.outcome()
        began, target = time.perf_counter(), self.target
        try:
            outcome = self.trial.run()
        except NotJudged as reason:
            target.faults.clear()
            outcome = self.outcome(*reason.args)
        if outcome is None and target.faults:
            outcome = target.outcome(np.inf)
        seconds = round(time.perf_counter() - began, 4)
        return outcome and replace(outcome, step=self.step, trial=self.name, kernel=target.kernel, seconds=seconds)


def ladder(
    programs: Programs,
    operation: str,
    dtypes: Sequence[str] = (),
    variants: Sequence[int] = (),
    steps: Sequence[str] = (),
    calling: Callable[[str | None], None] = lambda case: None,
    seed: int | str | None = None,
) -> Iterator[Step]:
    """The trials of one operation, in order; no program is called before `perform`.

    calling  is told the case's name before each call of the program, and None after it
    seed     of drawn inputs (T11), or the file of one; 0 by default, and none of refsim's own programs

    All dtypes, variants and steps by default. Raises InputError for what does not exist or cannot run here.
    """
    program, own = programs.operation(programs.operations((operation,))[0]), programs.programs is None
    among(dtypes, programs.dtypes, f"{programs.name} does not compute in")
    among(steps, tuple(STEPS), "there is no step")
    chosen, numbers = chosen_variants(program, variants), itertools.count()
    names = [n for n in program.names() if backend_of(n) == programs.arrays] if own else [programs.arrays]
    shared: dict[str, Any] = {name: getattr(programs, name) for name in ("excludes", "same_bits", "readings")}
    shared |= {"dims": (3,) if own else tuple(sorted(programs.dims, reverse=True)), "calling": calling}
    shared |= {"loader": None if own else programs.bound, "seed": 0 if seed is None and not own else seed}
    shared["sought"] = Sought()
    for name, dtype, variant, kernel in itertools.product(names, dtypes or DTYPES, chosen, programs.ladders(program)):
        overrides = program.as_computed_by(name).variants
        if variant >= len(overrides):
            continue
        at = Target(program, name, dtype, variant, kernel=kernel, **shared)
        reason = dtype if dtype not in programs.dtypes else programs.unsupported(program, overrides[variant])
        if reason:
            yield Step(next(numbers), at, not_judged=reason)
        else:
            yield from planned(at, steps or None, numbers)


def trials(
    programs: Programs, operation: str, dtypes: Names = (), variants: Numbers = (), steps: Names = (), seed: Seed = None
) -> Iterator[Outcome]:
    """Outcomes of the ladder for one operation as they come; all dtypes of the backend, variants and steps by default.

    Raises InputError for what does not exist or cannot run here.
    """
    return _climbed(ladder(programs, operation, dtypes or programs.dtypes, variants, steps, seed=seed))


def _climbed(steps: Iterable[Step]) -> Iterator[Outcome]:
    """Outcomes of the trials that apply."""
    return (outcome for step in steps if (outcome := step.perform()) is not None)


# The ladder of steps, each with an outcome for each trial


STEPS: dict[str, Callable[[Target], Iterator[Trial]]] = {
    "T1": closed_forms,
    "T2": hard_inputs,
    "T3": large_case,
    "T4": invariants,
    "T5": symmetries,
    "T6": repeats,
    "T7": additivity,
    "T9": bad_input,
    "T10": parameters,
    "T11": drawn_inputs,
}
AGAINST_ORACLE = ("T2", "T3", "T9", "T11")  # say nothing about the oracle itself


def run(operation: Operation | str, backend: str, dtype: str, case: str, variant: int = 0) -> Outcome:
    """One operation's program on one case against the oracle (T2)."""
    operation = REGISTRY[operation] if isinstance(operation, str) else operation
    target = Target(operation, backend, dtype, variant)
    trial = Trial(case, functools.partial(on_case, target, case))
    return Step(0, target, "T2", trial).perform()  # type: ignore[return-value]


def planned(target: Target, steps: Names | None = None, numbers: Iterator[int] | None = None) -> Iterator[Step]:
    """All trials, or those of the steps named; for the references those that judge them. No program is called."""
    numbers = numbers or itertools.count()
    for name in STEPS if steps is None else steps:
        if target.backend != "numpy" or name not in AGAINST_ORACLE:
            yield from (Step(next(numbers), target, name, trial) for trial in STEPS[name](target))


def climb(target: Target, steps: tuple[str, ...] | None = None) -> Iterator[Outcome]:
    """Outcomes of all steps, or of those named, as they come; for the references those that judge them."""
    return _climbed(planned(target, steps))
