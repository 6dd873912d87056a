"""`refsim show NAME`: an operation or an equation of a source, with the code that stands for it.

With `--backend` it prints the program as a file of its own, where it is one loop over rows.
"""

import argparse
import ast
import contextlib
import functools
import importlib
import inspect
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from refsim.backends.written import NotPlain, class_text, kind_of, literal, wrapped_line, written
from refsim.commands import CommandResult, command, takes
from refsim.commands.equations import Equation, equation, equations, page
from refsim.contract import bindings
from refsim.core.checked import suggestion
from refsim.core.errors import InputError, RefsimError
from refsim.core.operation import REGISTRY, Operation, backend_of
from refsim.smoothing.shapes import Smoothing


@dataclass(frozen=True)
class Source:
    """A function as it stands in a file; `line` is its first line."""

    module: str
    name: str
    line: int
    text: str

    def __str__(self) -> str:
        place = f"{self.module.replace('.', '/')}.py"
        return f"# {place}:{self.line}\n{self.text}" if self.line else f"# made for {place}\n{self.text}"


@functools.cache
def _function(module: str, name: str) -> Source | None:
    """A function of the module with its decorators, or one that a call in the module makes."""
    place = importlib.import_module(module)
    function = inspect.unwrap(getattr(place, name, None))  # type: ignore[arg-type]
    if not inspect.isfunction(function) or (function.__module__, function.__qualname__) != (module, name):
        return None
    lines, first = inspect.getsourcelines(function)
    line, text = first * (function.__code__.co_filename == place.__file__), "".join(lines).rstrip()
    return None if text[0] == " " else Source(module, name, line, text)  # of a class, or for the device alone


def source_of(module: str, name: str) -> Source:
    """A function with its decorators; raises InputError where the module does not define it."""
    function = _function(module, name)
    if function is None:
        raise InputError(f"{module} defines no function {name}, which `refsim show` could print.")
    return function


@functools.cache
def _calls(module: str, name: str) -> tuple[tuple[str, str], ...]:
    """(module, name) of the package's functions that a function calls."""
    known, found = vars(importlib.import_module(module)), dict[tuple[str, str], None]()
    for part in ast.walk(ast.parse(source_of(module, name).text)):
        named = known.get(part.id) if isinstance(part, ast.Name) else None
        if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
            named = getattr(known.get(part.value.id), part.attr, None)
        made = inspect.unwrap(named)  # type: ignore[arg-type]
        target = getattr(made, "__module__", None) or "", getattr(made, "__name__", "")
        if target[0].startswith("refsim.") and _function(*target):
            found[target] = None
    return tuple(found)


def called_by(module: str, name: str) -> list[tuple[str, str]]:
    """(module, name) of the package's functions that a function calls, directly or through others."""
    callees, waiting = dict[tuple[str, str], None](), [(module, name)]
    while waiting:
        new = [target for target in _calls(*waiting.pop(0)) if target not in callees]
        callees |= dict.fromkeys(new)
        waiting += new
    return list(callees)


def describe(operation: Operation, program: str) -> dict[str, list[Source]]:
    """Formulas, reference, program and helpers of the operation as Source objects, by heading."""
    module, name = operation.place(program)
    called = called_by(module, name)
    helpers = [place for place in called if place[0].startswith(operation.folder) and place[0] == module]
    return {
        "formulas": [source_of(*place) for place in called if place[0].endswith(".formulas")],
        "equations": [source_of(f.__module__, f.__name__) for f in operation.equations()],
        "reference": [source_of(*operation.place("numpy"))],
        "program": [source_of(module, name)],
        "helpers": [source_of(*place) for place in helpers],
    }


def shown(equation: Equation) -> CommandResult:
    """What is printed in the source, how it is read, and the code that stands for it."""
    lines = [equation.name if equation.source == "thesis" else f"{equation.name}, {equation.source}", equation.printed]
    for heading, sentence in (("read", equation.reading), ("not implemented", equation.reason)):
        lines += [f"{heading}: {sentence}"] * bool(sentence)
    lines += [f"tests: tests/ladder/test_pairing.py -k {name}" for name in equation.operations]
    code = {"reference": equation.references, "program": equation.kernels}
    sources = {key: [source_of(*place) for place in places] for key, places in code.items()}
    for key, heading in (("reference", "Reference"), ("program", "One neighbour or particle")):
        lines += ["", f"## {heading}", *(f"\n{source}" for source in sources[key])] * bool(sources[key])
    data = {key: [asdict(source) for source in of_kind] for key, of_kind in sources.items()}
    return CommandResult(asdict(equation) | data, "\n".join(lines), verbatim=True)


@command("show", "print an operation, or an equation of a source, and the code that stands for it")
@takes("operation", metavar="NAME",
       help="an operation, such as sph.momentum (`refsim list` names all); an equation of a source, such as"
       ' "J(10)" or "thesis (3.16)"; or `equations` for a list of those')  # fmt: skip
@takes("--backend", metavar="PROGRAM",
       help="print the program (cpu, cuda, or another one of the operation) as a file that runs by itself")  # fmt: skip
def execute(options: argparse.Namespace) -> CommandResult:
    """Print an operation, one of its programs as a file that runs by itself, an equation, or the list of equations."""
    operation = REGISTRY.get(options.operation)
    if options.operation == "equations":
        return CommandResult({"equations": [asdict(e) for e in equations()]}, page().rstrip(), verbatim=True)
    of_source = None if operation is not None else equation(options.operation)
    if of_source is not None:
        return shown(of_source)
    if operation is None:
        near = f"{suggestion(options.operation, REGISTRY)} " if "." in options.operation else ""
        raise InputError(
            f"There is no operation or equation {options.operation!r}; {near}`refsim list` has all operations,"
            " `refsim show equations` all equations."
        )
    programs = [name for name in operation.names() if name != "numpy"]
    program = options.backend or "cpu"
    if program not in programs:
        raise InputError(f"{operation.name} has no program {program!r}; choose one of {', '.join(programs)}.")
    about = {"operation": operation.name, "paper": operation.paper, "equation": operation.equation}
    text = printed(operation, program) if options.backend else None
    if text is not None:
        return CommandResult(about | {"program": program, "file": text}, text.rstrip("\n"), verbatim=True)
    description = describe(operation, program)
    more = {"equations": ": the term of one pair, or what follows from the sums", "program": f" {program}"}
    more["reference"] = ": NumPy, all pairs, float64"
    lines = [operation.name, f"{operation.paper}: {operation.equation}"]
    for key, sources in description.items():
        if sources:
            lines += ["", f"## {key.capitalize()}{more.get(key, '')}", *(f"\n{source}" for source in sources)]
    data = {key: [asdict(source) for source in sources] for key, sources in description.items()}
    return CommandResult(about | data, "\n".join(lines), verbatim=True)


# A program as a file that runs by itself


COUNT, CASE = 100, "cloud_3d"
MOST_NUMBERS = 9  # of an array that is written as it is
NEIGHBOURS = {
    "cpu": '''\
def neighbours_of(position, radius):
    """All pairs nearer than `radius` [m]; neighbours of i are entries[start[i] : start[i] + count[i]]."""
    near = ((position[:, None] - position) ** 2).sum(2) < radius**2
    np.fill_diagonal(near, False)
    count = near.sum(1)
    return NeighbourRows(np.cumsum(count) - count, count.astype(np.int32), near.nonzero()[1].astype(np.uint32))''',
    "cuda": '''\
def neighbours_of(position, radius):
    """All pairs nearer than `radius` [m]; the k-th neighbour of i is entries[k * n + i]."""
    near = ((position[:, None] - position) ** 2).sum(2) < radius**2
    np.fill_diagonal(near, False)
    columns = np.argsort(~near, axis=1, kind="stable").T  # the neighbours of each particle first
    return NeighbourColumns(near.sum(1).astype(np.int32), columns.astype(np.uint32).ravel())''',
}
EXAMPLE = '''\
def example(count={count}):
    """What `{name}` takes, of random particles."""
    rng = np.random.default_rng(1)
    {lines}
    {arguments}


if __name__ == "__main__":
    given = example()
    {name}{launch}(*given)
    {told}
'''


def kernel_of(operation: Operation, program: str) -> Any:
    """The kernel that a program is; None where it is a function that launches kernels, or reduces rows."""
    from refsim.backends.compile import Kernel  # which loads Numba, as no other command needs it
    from refsim.backends.reductions import Reduction

    module, name = operation.place(program)
    found = getattr(importlib.import_module(module), name)
    whole = isinstance(found, Kernel) and not isinstance(found, Reduction) and not operation.entry(program).packed
    return found if whole else None


def printed(operation: Operation, program: str) -> str | None:
    """The text of the file; None where the program has none. Without an example where random particles are no input."""
    from refsim.backends.compile import ANY_ORDER

    kernel, backend = kernel_of(operation, program), backend_of(program)
    if kernel is None:
        return None
    example = ""
    try:
        given = bindings(operation, "cpu", "float32", CASE, names=kernel.arguments)
        given = {name: _plainly(value, backend) for name, value in given.items()}
        kinds = {name: kind_of(value) for name, value in given.items()}
        with contextlib.suppress(NotPlain):
            example = _example(operation, kernel, given, backend)
        flags = ANY_ORDER - {"reassoc"} if kernel.options["cpu"]["ordered"] else ANY_ORDER
        text = written(kernel.wrapper({"cuda": "plain"}.get(backend, backend)), kinds, backend, flags, example)
    except (NotPlain, KeyError, RefsimError):
        return None
    return f'"""{operation.name}: {operation.equation} ({operation.paper})."""\n\n{text}'


def _plainly(value: Any, backend: str) -> Any:
    """A value with a known smoothing kernel, and the GPU's list in place of a CPU's."""
    from refsim.neighbours.rows import NeighbourColumns, NeighbourRows

    if isinstance(value, Smoothing):
        return value.fixed()
    if backend == "cuda" and isinstance(value, NeighbourRows):
        return NeighbourColumns(value.count, value.entries)
    return value


def _example(operation: Operation, kernel: Any, given: Mapping[str, Any], backend: str) -> str:
    """What makes the arguments, and runs the kernel. Raises NotPlain where random particles are no input."""
    taken = {name: value for name, value in given.items() if value is not None}
    if kernel.rows not in taken:
        raise NotPlain(kernel.rows)
    rows, radius = len(taken[kernel.rows]), next((n for n in taken if hasattr(taken[n], "support_radius")), "")
    order = sorted(taken, key=lambda name: (name != radius, name == "neighbours"))
    lines = [wrapped_line(f"    {name} = {_made(operation, name, taken[name], rows, radius)}") for name in order]
    classes = {type(value).__name__: type(value) for value in taken.values() if isinstance(value, tuple)}
    outputs = [name for name in operation.outputs if name in taken]
    told = (f'print("mean of |{name}|:", np.abs(given[{list(taken).index(name)}]).mean())' for name in outputs)
    main = EXAMPLE.format(
        count=COUNT, name=kernel.__name__, lines="\n".join(lines).lstrip(), told="\n    ".join(told),
        arguments=wrapped_line(f"    return ({', '.join(taken)}{',' * (len(taken) == 1)})").lstrip(),
        launch="[1, 128]" if backend == "cuda" else "",
    )  # fmt: skip
    return "\n\n\n".join([*map(class_text, classes.values()), *[NEIGHBOURS[backend]] * ("neighbours" in taken), main])


def _made(operation: Operation, name: str, value: Any, rows: int, radius: str) -> str:
    """An expression for an argument; `radius` is the group with the support radius.

    Raises NotPlain for one that random particles do not have.
    """
    if name == "neighbours":
        return f"neighbours_of(position, {radius}.support_radius)"
    if isinstance(value, tuple):
        numbers = value.numbered() if isinstance(value, Smoothing) else value
        if any(getattr(member, "ndim", 0) or isinstance(member, tuple) for member in numbers):
            raise NotPlain(name)
        members = zip(type(value)._fields, numbers)  # type: ignore[attr-defined]
        return f"{type(value).__name__}({', '.join(f'{n}={literal(v)}' for n, v in members)})"
    if not getattr(value, "ndim", 0):
        return literal(value)
    kind, per_row = f"np.{value.dtype.name}", len(value) == rows
    shape = ", ".join(["count", *map(str, value.shape[1:])]) if per_row else ""
    shape = f"({shape})" if value.ndim > 1 else shape or str(value.shape)
    read_too = value.dtype.kind == "f" and per_row and 0 < value.min() < value.max()  # and cannot be zero
    if name in operation.outputs and not read_too and (per_row or value.size <= MOST_NUMBERS):
        return f"np.zeros({shape if per_row else value.shape}, {kind})"
    if name == "position" and per_row:
        return f"rng.uniform(0, {f'2.4 * {radius}.support_radius' if radius else 1.0}, (count, 3)).astype({kind})"
    if value.size <= MOST_NUMBERS and not per_row:
        return literal(value)
    if not per_row or not np.isfinite(np.asarray(value, dtype=float)).all():
        raise NotPlain(name)
    if value.dtype.kind in "iub":
        return f"rng.integers({int(value.min())}, {min(int(value.max()), COUNT - 1) + 1}, {shape}).astype({kind})"
    low, high = (float(f"{end:.3g}") for end in (value.min(), value.max()))
    return f"rng.uniform({low}, {high}, {shape}).astype({kind})"
