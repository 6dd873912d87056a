"""The numbered equations, algorithms and tables of the five sources: what they say and where they stand in the code.

`refsim show equations` prints docs/equations.md, `refsim show "J(10)"` one of them. A line of equations.txt holds a
number, what is printed there, how it is read, and, behind `-`, why no function stands for it or, behind `=`, the
operations that do; otherwise the functions are those whose docstring begins with the number, or else has it.
"""

import ast
import functools
import itertools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from refsim.core.operation import REGISTRY, Operation

ROOT = Path(__file__).parents[1]
BAR = "\\|"
SEARCHES = ("neighbours", "sparse_grid")
MOST = 2  # programs that stand for an equation without a number of its own in them
LEADING = 25  # characters of a docstring, within which a number says what the function is
LOST = "lost in the source; read: "
OTHERS = ("operations", "cases", "__init__", "memory", "limits", "groups")  # modules without equations
FOLDERS = {
    "Dong, Zhang & Chen 2016": ("surface_tension",), "Shao & Song 2017": ("heat", "boundary"),
    "thesis": ("mpm", "surface_energy", "sparse_grid", "isosurface"),
    "patent CN104318598A": ("boundary", "surface_tension"),
}  # fmt: skip


class CodeLocation(NamedTuple):
    """A function of refsim."""

    module: str
    name: str


@dataclass(frozen=True)
class Equation:
    """An equation of a source: what is printed, how it is read, why no function stands for it, and what does."""

    source: str
    number: str
    printed: str
    reading: str
    reason: str
    references: tuple[CodeLocation, ...]
    kernels: tuple[CodeLocation, ...]
    operations: tuple[str, ...]

    @property
    def name(self) -> str:
        """With which `refsim show` prints it."""
        return f"thesis {self.number}" if self.source == "thesis" else self.number


@functools.cache
def _functions() -> dict[CodeLocation, tuple[str, int]]:
    """Every function of the modules that hold equations: its docstring, and its line in the file."""
    locations = {}
    for path in sorted(ROOT.rglob("*.py")):
        module = ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)
        if path.stem not in OTHERS and not path.stem.endswith("_cuda") and "recorded" not in path.parts:
            for node in ast.parse(path.read_text(encoding="utf-8")).body:
                docstring = ast.get_docstring(node) if isinstance(node, ast.FunctionDef) else None
                if isinstance(node, ast.FunctionDef) and docstring:
                    locations[CodeLocation(module, node.name)] = docstring, node.lineno
    return locations


@functools.cache
def _places(name: str) -> tuple[list[CodeLocation], CodeLocation]:
    """Equations of an operation's reference, or the whole where it is one function; its program on a CPU."""
    operation = REGISTRY[name]
    locations = [CodeLocation(f.__module__, f.__name__) for f in operation.equations()]
    equations = [place for place in locations if place.module.split(".")[1] not in SEARCHES]
    whole, program = (CodeLocation(*operation.place(name)) for name in ("numpy", "cpu"))
    return equations or [whole], program


def _numbers(docstring: str) -> str:
    """The words with what lies between two numbers, "D(8) to D(11)", written out."""
    ends = re.compile(r"([A-Z]?\((?:\d\.)?)(\d+)\) to [A-Z]?\((?:\d\.)?(\d+)\)")
    return ends.sub(lambda m: ", ".join(f"{m[1]}{n})" for n in range(int(m[2]), int(m[3]) + 1)), docstring)


@functools.cache
def equations() -> tuple[Equation, ...]:
    """All of them, in the order of the sources."""
    rows, source = [], ""
    for line in Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines():
        if line.startswith("# "):
            source = line.removeprefix("# ")
        elif line:
            rows.append(_equation(source, line))
    return tuple(rows)


def _equation(source: str, line: str) -> Equation:
    number, printed, reading, where = [*re.split(r" *:: *", line), "", "", ""][:4]
    label, folders = _label(number), FOLDERS.get(source)
    matches = {place: label.search(_numbers(docstring)) for place, (docstring, _) in _functions().items()}
    leads = {
        place: match.start() < LEADING for place, match in matches.items()
        if match and (folders is None or place.module.split(".")[1] in folders)
    }  # fmt: skip
    references, kernels = (
        [place for place in places if leads[place] or not any(map(leads.get, places))] for places in _kinds(leads)
    )
    kernels = _near(references, kernels) if references or not where else []
    of_paper = re.compile(rf"(?<!\w){re.escape(number.removeprefix('M') if number[:2] == 'M(' else number)}(?!\w)")
    named = [o for o in REGISTRY.values() if o.name in where.split()]
    cited = [o for o in REGISTRY.values() if source in o.paper and of_paper.search(_numbers(o.equation))]
    cited = [] if where.startswith("- ") or named else cited
    for operation in (*named, *(() if references else cited)):
        places, program = _places(operation.name)
        references += [place for place in places if place not in references]
        kernels += [program] * (program not in kernels)
    judged = [o for o in REGISTRY.values() if not {*references}.isdisjoint(_places(o.name)[0])]
    if references and not kernels:
        kernels = list(dict.fromkeys(_places(o.name)[1] for o in (*cited, *judged)))[:MOST]
    return Equation(
        source, number, printed, reading, "" if references else where.removeprefix("- "),
        tuple(references), tuple(kernels), tuple(dict.fromkeys(o.name for o in (*named, *cited, *judged))),
    )  # fmt: skip


def _label(number: str) -> re.Pattern[str]:
    """How docstrings have a number: M(4) or Shao & Song (4), (4.18) or, with its sign corrected, (4.18*)."""
    escaped = re.escape(number).replace(r"\)", r"\*?\)")
    return re.compile(rf"(?:\bM|Shao & Song |^){escaped[1:]}" if number[:2] == "M(" else rf"(?<!\w){escaped}(?!\w)")


def _kinds(places: Iterable[CodeLocation]) -> tuple[list[CodeLocation], list[CodeLocation]]:
    """References, and the rest."""
    references = [place for place in places if place.module.endswith(".reference")]
    return references, [place for place in places if place not in references]


def _near(references: list[CodeLocation], kernels: list[CodeLocation]) -> list[CodeLocation]:
    """Kernels beside the references, and of those what they do for one neighbour, where there are such."""
    folders = {place.module.rpartition(".")[0] for place in references}
    beside = [place for place in kernels if place.module.rpartition(".")[0] in folders] or kernels
    return [place for place in beside if place.name.endswith("_pair") or place.module.endswith(".formulas")] or beside


def equation(name: str) -> Equation | None:
    """The one that a name stands for, such as "J(10)" or "thesis (3.16)"."""
    wanted = re.sub(r"\s", "", name).lower().removeprefix("thesis")
    return next((e for e in equations() if e.number.replace(" ", "").lower() == wanted), None)


# The page

HEAD = """# Equations of the sources, one by one

In the order of each source: what is printed, how it is read where that differs ([errata](errata.md), by number), the
functions of the reference, and what a kernel computes for one neighbour or particle. `refsim show "J(10)"` prints an
equation with that code and its lines, others are "thesis (3.16)" and "P7"; `refsim show equations` prints this page.
Tests hold operations: `python -m pytest tests/ladder/test_pairing.py -k sph.density` compares the programs of one with
its reference and with closed forms.
"""
COLUMNS = ("number", "printed", "read", "reference", "neighbour or particle", "operations")
OTHERS_COLUMNS = ("operation", "paper", "equation", "reference", "program")


def page(site: bool = False) -> str:
    """docs/equations.md; on the site with the lines of functions, and with what is after other sources."""
    parts = [HEAD]
    for source, of_source in itertools.groupby(equations(), lambda equation: equation.source):
        rows = [_cells(equation, site) for equation in of_source]
        parts += [f"## {source[:1].upper()}{source[1:]}\n", *_table(COLUMNS, rows), ""]
    if site:
        told = {name for equation in equations() for name in equation.operations}
        rows = [_cells_of(operation) for operation in REGISTRY.values() if operation.name not in told]
        parts += ["## Other sources\n", *_table(OTHERS_COLUMNS, rows), ""]
    return "\n".join(parts)


def _cells(equation: Equation, lines: bool) -> tuple[str, ...]:
    lost = LOST if equation.printed.startswith(LOST) else ""
    return (
        f"**{equation.number}**", f"{lost}`{equation.printed.removeprefix(LOST)}`", equation.reading,
        _listed(equation.references, lines) or f"not implemented: {equation.reason}", _listed(equation.kernels, lines),
        ", ".join(f"`{name}`" for name in equation.operations),
    )  # fmt: skip


def _cells_of(operation: Operation) -> tuple[str, ...]:
    references, program = _places(operation.name)
    named = f"`{operation.name}`", operation.paper, f"`{operation.equation}`"
    return (*named, _listed(references, True), _listed([program], True))


def _listed(places: Iterable[CodeLocation], lines: bool) -> str:
    """Functions by file."""
    files: dict[str, list[str]] = {}
    for place in places:
        line = f" (line {_functions()[place][1]})" if lines and place in _functions() else ""
        file = place.module.removeprefix("refsim.").replace(".", "/")
        files.setdefault(file, []).append(f"`{place.name}`{line}")
    return "<br>".join(f"`{file}.py` {', '.join(names)}" for file, names in files.items())


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    for cells in (head, ["---" for _ in head], *rows):
        yield f"| {' | '.join(cell.replace('|', BAR) for cell in cells)} |"
