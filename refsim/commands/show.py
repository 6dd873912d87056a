"""`refsim show NAME`: an operation or an equation of a source, with the code that stands for it.

With `--backend` it prints the program as a file of its own (`refsim.commands.printed`), where it is one loop over rows.
"""

import argparse
import ast
import functools
import importlib
import importlib.util
import inspect
from dataclasses import asdict, dataclass
from pathlib import Path

from refsim.commands import CommandResult, command, takes
from refsim.commands.equations import Equation, equation, equations, page
from refsim.commands.printed import printed
from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.operation import REGISTRY, Operation


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
def file_of(module: str) -> Path | None:
    """The source of a module, of which no more than its package is imported; None where there is none."""
    try:
        spec = importlib.util.find_spec(module)
    except ModuleNotFoundError:
        return None
    return Path(spec.origin) if spec is not None and spec.origin is not None else None


@functools.cache
def parsed(module: str) -> tuple[str, ast.Module]:
    """Text and syntax tree of a module."""
    path = file_of(module)
    assert path is not None, module
    text = path.read_text(encoding="utf-8")
    return text, ast.parse(text)


@functools.cache
def _function(module: str, name: str) -> Source | None:
    """A function of the module with its decorators, or one that a call in the module makes."""
    text, tree = parsed(module)
    for node in tree.body:
        if isinstance(node, ast.FunctionDef) and node.name == name:
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            return Source(module, name, first, "\n".join(text.splitlines()[first - 1 : node.end_lineno]))
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call) and name in ast.unparse(node.targets[0]):
            made = inspect.unwrap(getattr(importlib.import_module(module), name, None))  # type: ignore[arg-type]
            if inspect.isfunction(made) and made.__name__ == name:
                return Source(module, name, 0, inspect.getsource(made).rstrip())
    return None


def source_of(module: str, name: str) -> Source:
    """A function with its decorators; raises InputError where the module does not define it."""
    function = _function(module, name)
    if function is None:
        raise InputError(f"{module} defines no function {name}, which `refsim show` could print.")
    return function


@functools.cache
def _imported(module: str) -> dict[str, str]:
    """What the module imports of its own package, by the name that it uses."""
    imports: dict[str, str] = {}
    for node in parsed(module)[1].body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(module.partition(".")[0]):
            imports |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    return imports


def called_by(module: str, name: str) -> list[tuple[str, str]]:
    """(module, name) of the package's functions that a function calls, directly or through others."""
    callees: dict[tuple[str, str], None] = {}
    waiting = [(module, name)]
    while waiting:
        place, function = waiting.pop(0)
        source = _function(place, function)
        for part in ast.walk(ast.parse(source.text)) if source is not None else ():
            if isinstance(part, ast.Attribute) and isinstance(part.value, ast.Name):
                target = (_imported(place).get(part.value.id, ""), part.attr)
            elif isinstance(part, ast.Name):
                full = _imported(place).get(part.id, f"{place}.{part.id}")
                target = (full.rpartition(".")[0], full.rpartition(".")[2])
            else:
                continue
            if (
                target not in callees
                and target[0]
                and file_of(target[0]) is not None
                and _function(*target) is not None
            ):
                callees[target] = None
                waiting.append(target)
    return list(callees)


def describe(operation: Operation, program: str) -> dict[str, list[Source]]:
    """Formulas, reference, program and helpers of the operation as Source objects, by heading."""
    reference, entry = operation.entry("numpy"), operation.entry(program)
    module, name = f"{entry.folder or operation.folder}.{entry.module}", entry.function or operation.function
    called = called_by(module, name)
    description = {
        "formulas": [source_of(*place) for place in called if place[0].endswith(".formulas")],
        "equations": [source_of(f.__module__, f.__name__) for f in operation.equations()],
        "reference": [source_of(f"{operation.folder}.{reference.module}", operation.function)],
        "program": [source_of(module, name)],
        "helpers": [
            source_of(*place) for place in called if place[0].startswith(operation.folder) and place[0] == module
        ],
    }
    return description


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
    headings = {
        "formulas": "Formulas",
        "equations": "Equations: the term of one pair, or what follows from the sums",
        "reference": "Reference: NumPy, all pairs, float64",
        "program": f"Program {program}",
        "helpers": "Helpers",
    }
    lines = [operation.name, f"{operation.paper}: {operation.equation}"]
    for key, heading in headings.items():
        if description.get(key):
            lines += ["", f"## {heading}", *(f"\n{source}" for source in description[key])]
    data = {key: [asdict(source) for source in sources] for key, sources in description.items()}
    return CommandResult(about | data, "\n".join(lines), verbatim=True)
