"""One equation, its programs, its hard inputs: the registry that makes the tests.

An operation is registered by the decorator `operation` on its NumPy program, its reference, which judges the others. A
program is named by its backend ("numpy", "cpu", "cuda") or, where a backend has another algorithm beside the plain one,
by backend and algorithm ("cuda:fused").

Arguments are bound by name. A program names the arrays and parameter groups it takes; its outputs stand last. An
argument of a function that is annotated as a named tuple stands for the tuple's members.
The reference takes the same names, less the neighbour structures and the outputs, and returns
`{output: (value, scale)}` or Terms, where `scale` is the sum of the absolute terms behind each value; for a flag it
is the margin: the relative distance of the decision from flipping.
"""

import ast
import functools
import importlib
import inspect
import itertools
import sys
import textwrap
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, TypeVar

BACKENDS = ("numpy", "cpu", "cuda")
SYMMETRY = "translation rotation reordering"  # invariants of what depends on separations
Reference = TypeVar("Reference", bound=Callable)
Names = str | tuple[str, ...]  # a string holds them with spaces between
LISTS = ("adds", "exact", "optional", "invariants", "cases")  # fields of Operation that hold names


@dataclass(frozen=True)
class Program:
    """Where a program of an operation stands, and what differs from the operation's plain program.

    also       operations that it computes in the same loop over the neighbours, accelerations added up; a GPU launches
               it in place of the passes of all of them, so that each neighbour is read once
    names      what an argument of the operations' references is called in such a program, where names differ; of one
               operation's alone by "operation.argument"
    """

    module: str  # of the operation's folder, or of `folder`
    function: str = ""  # in it; by default the one that has the operation's function's name
    also: tuple[str, ...] = ()
    names: Mapping[str, str] = field(default_factory=dict)
    tolerance: float | None = None  # c of its own bound, with the reason in `reason`; None for that of the operation
    reason: str = ""
    variants: tuple[Any, ...] | None = None  # argument overrides under which it is tested; None for the operation's
    work: tuple[str, ...] = ()  # arguments beside the operation's that serve as work space
    folder: str = ""  # package of the module; by default the operation's, which may be of an earlier method
    packed: str = ""  # pair function of the module, whose neighbours' fields the function then reads packed

    def called(self, part: "Operation", argument: str) -> str:
        """What the program calls an argument of a part's reference."""
        return self.names.get(f"{part.name}.{argument}", self.names.get(argument, argument))


PLAIN = {"numpy": Program("operations"), "cpu": Program("kernels"), "cuda": Program("kernels")}


@dataclass(frozen=True)
class Operation:
    """One equation of one paper and where its programs stand.

    work        arguments, or members of groups ("group.member"), that serve as work space: the contract lets a program
                change them, and no other input
    variants    argument overrides under which the operation is tested: None drops an optional term, a mapping gives
                members of a parameter group, a function of (case, grid) makes the value; the first is the plain one,
                without what is optional, or with what `refsim.core.cases.plain_keeps` names
    """

    name: str  # "folder.operation", unique
    folder: str  # the package that holds reference.py, operations.py and kernels.py
    paper: str  # author and year, or "standard"
    equation: str  # the paper's number, with the erratum and its source where the adopted reading differs
    function: str  # name of the function in operations.py and kernels.py
    outputs: tuple[str, ...]  # kernel arguments that are written
    exact: tuple[str, ...] = ()  # outputs compared exactly wherever the margin exceeds tolerance * eps
    adds: tuple[str, ...] = ()  # outputs to which the kernel adds instead of assigning
    halo_depth: int = 1  # how many neighbourhoods away one particle's values act; 0 where they may act on all
    work: tuple[str, ...] = ()
    entrywise: tuple[str, ...] = ()  # outputs of the whole set with a bound for each entry; its scale counts the terms
    optional: tuple[str, ...] = ()  # arguments that are None where the scene has no such thing
    tolerance: float = 4.0  # c in the bound c * neighbours * eps * sum|terms|, with its reason in `reason`
    reason: str = "one rounding in each of distance, kernel, product and sum, and a few in the kernel's polynomial"
    variants: tuple[Mapping[str, Any], ...] = field(default_factory=lambda: ({},))
    invariants: tuple[str, ...] = ()  # names of the contract's conservation and symmetry checks that hold
    broken: Mapping[int, tuple[str, ...]] = field(default_factory=dict)  # invariants that a variant, by number, breaks
    cases: tuple[str, ...] = ()  # names of hard inputs beside the common ones
    programs: Mapping[str, Program] = field(default_factory=dict)  # elsewhere, or beside the plain ones, by name

    def names(self) -> tuple[str, ...]:
        """Names of all its programs: the backends, and backend and algorithm where there are more."""
        return (*BACKENDS, *(name for name in self.programs if name not in BACKENDS))

    def chosen(self, backend: str, algorithm: str) -> str:
        """Name of the program for an algorithm on a backend: the plain one where the backend has no other."""
        name = f"{backend}:{algorithm}"
        return name if name in self.programs else backend

    def entry(self, name: str) -> Program:
        """Where the program called `name` stands; raises KeyError if there is none."""
        return self.programs[name] if name in self.programs else PLAIN[name]

    def program(self, name: str) -> Callable:
        """The function that is the program called `name`, imported at first use."""
        return _program(*self.place(name), backend_of(name), self.entry(name).packed)

    def place(self, name: str) -> tuple[str, str]:
        """(module, function) of the program called `name`."""
        entry = self.entry(name)
        return f"{entry.folder or self.folder}.{entry.module}", entry.function or self.function

    def as_computed_by(self, name: str) -> "Operation":
        """The operation that judges the program called `name`: this one, with what the program's entry changes.

        Where the program computes other operations, too, its reference does, and adds accelerations up. Asked again,
        the result is the same.
        """
        entry = self.entry(name)
        changed: dict[str, Any] = {"work": tuple(dict.fromkeys((*self.work, *entry.work)))}
        if entry.tolerance is not None:
            changed |= {"tolerance": entry.tolerance, "reason": entry.reason}
        if entry.variants is not None:
            changed |= {"variants": entry.variants, "broken": {}}
        if not entry.also:
            return replace(self, **changed)
        parts = (self, *(REGISTRY[part] for part in entry.also))
        kept = [set(part.invariants).difference(*part.broken.values()) for part in parts]
        changed |= {
            "name": f"{self.name}:{name.partition(':')[2]}",
            "outputs": tuple(dict.fromkeys(entry.called(p, name) for p in reversed(parts) for name in p.outputs)),
            "adds": tuple(dict.fromkeys(name for part in parts for name in part.adds)),
            "optional": tuple(dict.fromkeys(name for part in parts for name in part.optional)),
            "invariants": tuple(invariant for invariant in self.invariants if all(invariant in k for k in kept)),
            "cases": tuple(dict.fromkeys(case for part in parts for case in part.cases)),
            "tolerance": max(changed.get("tolerance", 0.0), *(part.tolerance for part in parts)),
        }
        shared = {f.name: getattr(self, f.name) for f in fields(Operation)}
        return Fused(**(shared | changed), parts=parts, together=entry)

    def arguments(self, name: str) -> tuple[str, ...]:
        """Names that the program called `name` takes, in order."""
        return _arguments(self.program(name))

    def equations(self) -> list[Callable]:
        """Functions of reference.py that the plain NumPy program in operations.py calls, directly or through others."""
        waiting: list[Any] = [inspect.unwrap(self.program("numpy"))]
        functions = dict[Any, None]()
        while waiting:
            place = waiting.pop(0)
            if place not in functions:
                functions[place] = None
                waiting += _called(place)
        return [f for f in functions if inspect.isfunction(f) and f.__module__.endswith(".reference")]

    def launch(self, backend: str, *arguments: Any) -> None:
        """Run the plain program of a backend on the arguments of the reference and, behind them, the outputs."""
        if backend == "numpy":
            names = (*self.arguments("numpy"), *self.outputs)
            self.bind("numpy", dict(zip(names, arguments, strict=True)).__getitem__)()
        else:
            self.program(backend)(*arguments)

    def bind(self, program: str, lookup: Callable[[str], Any]) -> Callable[[], None]:
        """A call without arguments: the program of that name on the values that `lookup` gives for its arguments."""
        function = self.program(program)
        values = [lookup(name) for name in self.arguments(program)]
        if program != "numpy":
            if any(isinstance(value, LiveAttribute) for value in values):
                return RebindingCall(function, values)
            return functools.partial(function, *values)
        targets = {name: lookup(name) for name in self.outputs}

        def call() -> None:
            for name, (value, _) in function(*map(live_value, values)).items():
                target = live_value(targets[name])
                if target is None:
                    continue
                if name in self.adds:
                    target += value.astype(target.dtype)
                else:
                    target[...] = value

        return call


@dataclass(frozen=True)
class Fused(Operation):
    """What a program computes that stands for several operations: all of theirs, the sum of accelerations."""

    parts: tuple[Operation, ...] = ()
    together: Program = PLAIN["cuda"]

    def as_computed_by(self, name: str) -> Operation:
        """This one, which is judged by the sum of its parts already."""
        return self

    def program(self, name: str) -> Callable:
        """As Operation's; the reference is the sum of the parts' references."""
        return self._sum if name == "numpy" else super().program(name)

    def arguments(self, name: str) -> tuple[str, ...]:
        """Names that the program called `name` takes; of the reference those that one of the parts takes."""
        if name != "numpy":
            return super().arguments(name)
        called = self.together.called
        return tuple(dict.fromkeys(called(part, a) for part in self.parts for a in part.arguments(name)))

    def _sum(self, *values: Any, rows: Any = None) -> dict[str, tuple[Any, Any]]:
        given = dict(zip(self.arguments("numpy"), values))
        total: dict[str, tuple[Any, Any]] = {}
        for part in self.parts:
            taken = [given[self.together.called(part, name)] for name in part.arguments("numpy")]
            answer = part.program("numpy")(*taken, rows=rows)
            for output, terms in answer.items():
                name = self.together.called(part, output)
                total[name] = tuple(map(sum, zip(total.get(name, (0, 0)), terms)))  # type: ignore[assignment]
        return total


@dataclass(frozen=True)
class LiveAttribute:
    """Attribute `name` of an object of the run, taken anew at each launch: an array whose size changes, say."""

    owner: Any
    name: str


def live_value(value: Any) -> Any:
    """What a LiveAttribute stands for at present; any other value as it is."""
    return getattr(value.owner, value.name) if isinstance(value, LiveAttribute) else value


@dataclass(frozen=True)
class RebindingCall:
    """A call of which some values are taken anew at each launch; `func` and `args` as of functools.partial."""

    func: Callable
    values: list[Any]

    @property
    def args(self) -> tuple[Any, ...]:
        """The values at present."""
        return tuple(map(live_value, self.values))

    def __call__(self) -> None:
        self.func(*self.args)


REGISTRY: dict[str, Operation] = {}


def operation(
    equation: str,
    name: str = "",
    *,
    outputs: Names = "",
    entrywise: Names | bool = "",
    variants: tuple[str | Mapping[str, Any], ...] = (),
    broken: Mapping[int, Names] | None = None,
    programs: Mapping[str, str | Program] | None = None,
    packed: str = "",
    **more: Any,
) -> Callable[[Reference], Reference]:
    """Register an operation on its reference, which stays the plain function that it is.

    name       where it is not that of the folder and the function, "sph.state"
    outputs    by default those to which it adds
    entrywise  True for all outputs that are not exact
    variants   of each the names of what is left out, or the overrides (`without`), where a string names a function of
               (case, grid) in the folder's cases.py; by default one without all that is optional, and one with it.
               What one of them leaves out is optional
    programs   by name; of one that differs by its module alone, the module
    packed     pair function of the kernel, of which a program "cuda:packed" is made
    more       other fields of Operation; of those in LISTS the names
    """

    def enter_on(reference: Reference) -> Reference:
        folder = reference.__module__.rpartition(".")[0]
        given: dict[str, Any] = {key: _names(value) if key in LISTS else value for key, value in more.items()}
        written, flags, left_out = (given.get(key, ()) for key in ("adds", "exact", "optional"))
        written = _names(outputs) or written
        made = {**(programs or {}), **({"cuda:packed": Program("kernels", packed=packed)} if packed else {})}
        chosen = variants or ((dict.fromkeys(left_out), {}) if left_out else ({},))
        tried = tuple(_overrides(variant, folder) for variant in chosen)
        left_out = (*left_out, *(argument for variant in tried for argument in variant if variant[argument] is None))
        entered = name or f"{folder.rpartition('.')[2]}.{reference.__name__}"
        if entered in REGISTRY:
            raise ValueError(f"operation {entered!r} is registered twice")
        REGISTRY[entered] = Operation(
            name=entered,
            folder=folder,
            equation=equation,
            function=reference.__name__,
            outputs=written,
            entrywise=tuple(n for n in written if n not in flags) if entrywise is True else _names(entrywise or ""),
            variants=tried,
            broken={number: _names(names) for number, names in (broken or {}).items()},
            programs={key: _entry(program, folder) for key, program in made.items()},
            **given | {"optional": tuple(dict.fromkeys(left_out))},
        )
        return reference

    return enter_on


def operations(**common: Any) -> Callable[..., Callable[[Reference], Reference]]:
    """`operation` with what the operations of a reference share, `operations(paper="Jiang & Zhu 2023")`."""
    return functools.partial(operation, **common)


def without(names: str, **overrides: Any) -> dict[str, Any]:
    """A variant that leaves out the arguments of these names and overrides others."""
    return dict.fromkeys(names.split()) | overrides


def add_program(operation: str, name: str, program: Program) -> None:
    """Enter another method's program of a registered operation; each program's name is entered once."""
    entered = REGISTRY[operation]
    if name in entered.programs:
        raise ValueError(f"operation {operation!r} has a program {name!r} already")
    REGISTRY[operation] = replace(entered, programs={**entered.programs, name: program})


@dataclass(frozen=True)
class Procedure:
    """Sequence of operations that an object of the run launches for the pass of the same name."""

    name: str
    owner: str  # what the object is called among the parameter groups
    method: str  # of the object, which gets what `takes` names
    takes: tuple[str, ...]
    operations: tuple[str, ...]  # names of the operations that it launches, for `refsim plan`

    def bind(self, lookup: Callable[[str], Any]) -> Callable[[], Any]:
        """A call without arguments on the values that `lookup` gives for the names; it returns what the method does."""
        values = [lookup(name) for name in (self.owner, *self.takes)]

        def call() -> Any:
            owner, *arguments = map(live_value, values)
            return getattr(owner, self.method)(*arguments)

        return call


PROCEDURES: dict[str, Procedure] = {}


def enter(procedure: Procedure) -> None:
    """Enter a procedure; no operation may have its name."""
    if procedure.name in PROCEDURES or procedure.name in REGISTRY:
        raise ValueError(f"procedure {procedure.name!r} has a name that is taken")
    PROCEDURES[procedure.name] = procedure


@dataclass(frozen=True)
class CaseValue:
    """Value of an argument that a function of (case, grid) in a folder's cases.py makes, imported at first use."""

    folder: str
    function: str

    def __call__(self, case: Any, grid: Any) -> Any:
        return getattr(importlib.import_module(f"{self.folder}.cases"), self.function)(case, grid)


def backend_of(program: str) -> str:
    """The backend on which the program of this name runs."""
    return program.partition(":")[0]


def _names(given: Names) -> tuple[str, ...]:
    return tuple(given.split()) if isinstance(given, str) else given


def _entry(program: str | Program, folder: str) -> Program:
    if isinstance(program, str):
        return Program(program)
    made = program.variants and tuple(_overrides(variant, folder) for variant in program.variants)
    return replace(program, variants=made)


def _overrides(variant: str | Mapping[str, Any], folder: str) -> dict[str, Any]:
    if isinstance(variant, str):
        return dict.fromkeys(variant.split())
    return {name: CaseValue(folder, value) if isinstance(value, str) else value for name, value in variant.items()}


@functools.cache
def _called(place: Any) -> list[Any]:
    """Functions and classes of references and operations that the source of one of them calls, or hands on as m.f."""
    known, found = vars(sys.modules[place.__module__]), []
    for part in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(place)))):
        named = [part.func] if isinstance(part, ast.Call) else part.bases if isinstance(part, ast.ClassDef) else []
        callees = [known.get(name.id) for name in named if isinstance(name, ast.Name)]
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
            module = known.get(part.value.id)
            callees = [getattr(module, part.attr, None)] if inspect.ismodule(module) else []
        judges = (one for one in callees if inspect.isroutine(one) or inspect.isclass(one))
        found += [one for one in judges if (one.__module__ or "").rpartition(".")[2] in ("reference", "operations")]
    return found


@functools.cache
def _arguments(function: Callable) -> tuple[str, ...]:
    """Names that a program takes, but for `rows`."""
    names = inspect.signature(getattr(function, "py_func", function)).parameters
    return tuple(name for name in names if name != "rows")


@functools.cache
def _program(module: str, function: str, backend: str, packed: str) -> Callable:
    place = importlib.import_module(module)
    program = getattr(place, function)
    if packed:
        return getattr(place, packed).packed(program)
    return _ungrouped(program.program(backend) if hasattr(program, "program") else program)  # what a body makes


def _ungrouped(function: Callable) -> Callable:
    """A program that takes the members of a named tuple where `function` has an argument annotated as one."""
    taken = list(inspect.signature(function).parameters.values()) if inspect.isfunction(function) else []
    groups = [getattr(argument.annotation, "_fields", ()) and argument.annotation for argument in taken]
    if not any(groups):
        return function

    @functools.wraps(function)
    def program(*values: Any, **options: Any) -> Any:
        rest = iter(values)
        return function(*(g(*itertools.islice(rest, len(g._fields))) if g else next(rest) for g in given), **options)

    given = [group for argument, group in zip(taken, groups) if argument.name != "rows"]
    names = [n for argument, g in zip(taken, groups) for n in (g._fields if g else (argument.name,))]
    if hasattr(function, "cleared"):
        program.cleared = _ungrouped(function.cleared)  # type: ignore[attr-defined]
    kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
    program.__signature__ = inspect.Signature([inspect.Parameter(n, kind) for n in names])  # type: ignore[attr-defined]
    return program
