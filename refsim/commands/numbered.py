"""Equations of the sources by their numbers: which functions state each, as their docstrings say.

A line of a docstring that begins with a number, "J(10) a_i = ...", makes its function one of that equation.
"""

import ast
import functools
import pathlib
import re
from collections.abc import Iterator
from dataclasses import dataclass

ROOT = pathlib.Path(__file__).resolve().parent.parent
FILES = ("reference", "formulas", "kernels")
HEAD = 60  # characters of a line in which numbers stand


@dataclass(frozen=True)
class Numbered:
    """A source of numbered equations and algorithms.

    form     of a number, as `refsim show` and the pages have it
    tag      regular expression of a number, with one group
    numbers  in the source's order
    absent   (numbers, why no function states them or what does in their place)
    folders  of whose functions the numbers are
    note     on all of them
    """

    title: str
    form: str
    tag: str
    numbers: tuple[str, ...]
    absent: tuple[tuple[str, str], ...] = ()
    folders: tuple[str, ...] = ("",)
    note: str = ""

    def label(self, number: str) -> str:
        """A number as it is called: J(10), thesis (4.18), thesis Algorithm 2."""
        return self.form.format(f"({number})" if number[0].isdigit() else f" {number}").replace("  ", " ").strip()

    def reason(self, number: str) -> str:
        """Why no function states the number; "" of one that is computed."""
        return next((why for numbers, why in self.absent if number in numbers.split()), "")


@dataclass(frozen=True)
class Stated:
    """A function that states an equation, and the line of its docstring that does."""

    module: str
    name: str
    line: int
    words: str


def _series(last: int, chapter: str = "") -> tuple[str, ...]:
    return tuple(f"{chapter}{k}" for k in range(1, last + 1))


SOURCES = (
    Numbered(
        "Jiang & Zhu 2023", "J{}", r"\bJ\((\d+)\)", _series(21),
        (
            ("1 2 3 4", "interpolation by a kernel, of which every sum is made; (2) is misprinted and unused"),
            ("5", "in its place stands a stiff equation of state, J(9)"),
            ("6", "the sum of J(10), J(11), gravity and tension, which the time loop adds up"),
        ),
    ),
    Numbered(
        "Dong, Zhang & Chen 2016", "D{}", r"\bD\((\d+)\)", _series(11),
        (
            ("1", "interpolation by a kernel, of which every sum is made"),
            ("2", "the sum of D(4), D(5), gravity and tension, which the time loop adds up"),
            ("8", "the force of one pair in the sum D(9)"), ("10", "a property of D(9), which E21 restores"),
            ("11", "the normals are those of J(19), over h"),
        ),
        note="The formulas (1) to (11) are lost in the text that was worked from; they follow the papers it cites.",
    ),
    Numbered(
        "thesis on MPM with surface tension", "thesis {}", r"(?:\((\d\.\d+)\*?\)|(Algorithm \d))",
        (*_series(13, "2."), *_series(19, "3."), "Algorithm 1", "Algorithm 2", *_series(19, "4.")),
        (
            (" ".join(_series(13, "2.")), "the continuum, which (4.8) to (4.19) discretise"),
            ("3.1 3.2 3.3 3.4", "level set and least squares, whose normal equations are (3.5)"),
            ("3.5", "the normal equations, which (3.6) solves"),
            ("3.10 3.11 3.12 3.13 3.14 3.15 3.18", "steps to (3.17)"),
            ("3.16", "the moment of a spline, (h^2/4) 1, in (3.17) and (4.13)"), ("3.19", "(3.17), normalised"),
            ("4.1 4.2 4.3 4.4 4.6 4.7", "variation and weak form, whose sums over particles are (4.17) and (4.18)"),
            ("4.5", "area of a sample: that of the surface over their number"), ("4.9", "the step of F, (4.16)"),
            ("4.11", "the quotient of (4.15) and (4.10)"), ("4.13 4.14", "computed with (4.12)"),
        ),
        ("mpm", "surface_energy", "isosurface", "sparse_grid"),
    ),
    Numbered(
        "Shao & Song 2017", "M{}", r"(?:\bM|Shao & Song |^)\((\d)\)", _series(4),
        folders=("boundary/two_way_coupling", "heat", "shape_matching", "melting"),
    ),
    Numbered(
        "patent CN104318598A", "{}", r"\b(P\d)\b", _series(8, "P"),
        (("P5", "the sum J(7) over liquid and walls"),),
    ),
)  # fmt: skip


def _numbers(words: str, source: Numbered) -> Iterator[str]:
    found = list(re.finditer(source.tag, words.strip()[:HEAD].partition(" = ")[0]))
    if found and found[0].start() <= len(source.title):
        yield from dict.fromkeys(match[match.lastindex or 0] for match in found)


@functools.cache
def stated() -> dict[tuple[str, str], list[Stated]]:
    """Functions by (title of the source, number): references first, then formulas, then kernels."""
    found: dict[tuple[str, str], list[Stated]] = {}
    for path in (path for stem in FILES for path in sorted(ROOT.rglob(f"{stem}.py"))):
        folder = path.parent.relative_to(ROOT).as_posix()
        module = f"refsim.{folder.replace('/', '.')}.{path.stem}"
        functions = [n for n in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(n, ast.FunctionDef)]
        for source in (source for source in SOURCES if folder.startswith(source.folders)):
            for node in functions:
                lines = (ast.get_docstring(node) or "").splitlines()
                for number, words in {n: line for line in reversed(lines) for n in _numbers(line, source)}.items():
                    where = Stated(module, node.name, node.lineno, words.strip())
                    found.setdefault((source.title, number), []).append(where)
    return found


def named(words: str) -> tuple[Numbered, str] | None:
    """Source and number of an equation "J(10)" or "thesis (3.16)"; None of other words."""
    plain = "".join(words.lower().split())
    for source in SOURCES:
        for number in source.numbers:
            if plain == "".join(source.label(number).lower().split()):
                return source, number
    return None
