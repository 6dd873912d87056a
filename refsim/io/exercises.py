"""Exercises of the lessons: an answer is judged by code that stands in the lesson, and a wrong one is told why.

A block fenced as `{judge} N` stands below exercise N. It knows the lesson's names, `answer`, and `HELPERS` of this
module. It raises `WrongAnswer`, or sets `right`, the words for a right answer. Notebooks and pages do not show it.

Lessons are text notebooks in MyST markdown, in the package. Blocks fenced as `{code-cell}` are executed in order, in
one namespace. Blocks fenced as `python` stand in folded answers (`<details>`); they are folded cells of the notebook.
"""

import functools
import importlib.resources
import inspect
import json
import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

OPEN = "replace the three dots by your answer"
# Units that an answer may be written with, by what they measure; `docs/_static/live.js` has those of its questions.
UNITS: tuple[dict[str, float], ...] = (
    {"": 1, "%": 0.01},
    {"m": 1, "dm": 0.1, "cm": 0.01, "mm": 0.001},
    {"s": 1, "ms": 0.001, "min": 60, "h": 3600, "hours": 3600},
    {"Pa s": 1, "mPa s": 0.001},
    {"particles": 1, "particle": 1},
)
WRITTEN = re.compile(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(?:/\s*([\d.]+))?\s*(\D*)", re.IGNORECASE)


class WrongAnswer(Exception):
    """Says what is wrong with an answer."""


class Verdict(NamedTuple):
    """Whether an answer is right, and what is said about it."""

    right: bool
    words: str


class Approximate(NamedTuple):
    """A value, and the relative error with which it is meant."""

    value: Any
    error: float


class Exercises:
    """The exercises of a lesson; called with the number of one and an answer, it prints what it thinks of it."""

    def __init__(self, lesson: str, names: Mapping[str, Any]) -> None:
        """Take the judges of a lesson, such as "1_surface_particles", and the names that they may use: `globals()`."""
        self.judges = judges(lessons()[lesson])
        self.names = names
        self.verdicts: dict[int, Verdict] = {}  # the last of each exercise

    def verdict(self, exercise: int, answer: Any) -> Verdict:
        """Judge an answer."""
        given: list[Any] = []  # what the answer, a function, was called with last

        def call(function: Any, *values: Any) -> Any:
            given[:] = [value.copy() if isinstance(value, np.ndarray) else value for value in values]
            return told(called, function, *values)

        def told(helper: Any, *values: Any, **more: Any) -> Any:
            try:
                return helper(*values, **more)
            except WrongAnswer as wrong:
                raise WrongAnswer(f"{wrong}{'' if OPEN in str(wrong) else tried(answer, given)}") from None

        beside = {"answer": answer, "called": call, "compare": functools.partial(told, compare)}
        known = dict(self.names) | HELPERS | beside
        try:
            if answer is ... or (isinstance(answer, tuple | list) and any(part is ... for part in answer)):
                raise WrongAnswer(f"{OPEN}.")
            exec(compile(self.judges[exercise], f"judge of exercise {exercise}", "exec"), known)
        except WrongAnswer as wrong:
            return Verdict(False, str(wrong))
        return Verdict(True, known["right"])

    def __call__(self, exercise: int, answer: Any) -> None:
        """Judge an answer and print the verdict."""
        verdict = self.verdicts[exercise] = self.verdict(exercise, answer)
        print(f"Exercise {exercise}: {'right' if verdict.right else 'not yet'}: {verdict.words}")


def tried(answer: Any, given: list[Any]) -> str:
    """The sentence that says with which numbers, arrays and functions the answer was called; none where it was not."""
    try:
        names = list(inspect.signature(answer).parameters)
    except (TypeError, ValueError):
        names = []
    said = []
    for place, value in enumerate(given):
        if isinstance(value, np.ndarray):
            text = " ".join(np.array2string(value, precision=3, threshold=6, edgeitems=1).split())
            text = f"{text} of shape {value.shape}"
        elif isinstance(value, float) or callable(value):
            text = f"{value:.6g}" if isinstance(value, float) else value.__name__
        else:
            continue
        said.append(f"{names[place]} = {text}" if len(names) == len(given) else text)
    return f" Tried: {', '.join(said)}." if said else ""


def read(text: str, unit: str) -> float:
    """The number that a text writes, such as "0.5", "0,5", "3/16" or "12 cm", in a unit of `UNITS`.

    Raises WrongAnswer.
    """
    match = WRITTEN.fullmatch(text.strip().replace(",", ".").replace("\u2212", "-"))
    try:
        value = float(match[1]) / float(match[2] or 1) if match else None
    except (ValueError, ZeroDivisionError):
        value = None
    if match is None or value is None:
        raise WrongAnswer(f"this is {text!r}; write one number, such as 0.5 or 3/16.")
    units = next(units for units in UNITS if unit in units)
    written = match[3].strip().replace("\u00b7", " ") or unit
    if written not in units:
        raise WrongAnswer(f"{text!r} is not {f'in {unit}' if unit else 'a plain number'}, and that is asked for.")
    return value * units[written] / units[unit]


def number(answer: Any, unit: str = "") -> float:
    """The answer as one finite number, in a unit of `UNITS` where it is a text with a unit; raises WrongAnswer."""
    return float(numbers(answer, (), unit))


def numbers(answer: Any, shape: tuple[int, ...], unit: str = "") -> np.ndarray:
    """The answer as an array of finite numbers of a shape; raises WrongAnswer."""
    wanted = f"numbers in an array of shape {shape}" if shape else "one number"
    if isinstance(answer, str):
        answer = read(answer, unit)
    elif isinstance(answer, list | tuple):
        answer = [read(part, unit) if isinstance(part, str) else part for part in answer]
    if callable(answer):
        raise WrongAnswer(f"this is a function: call it, with brackets. Asked for: {wanted}.")
    if answer is None:
        raise WrongAnswer("this is None: a function that gives nothing back lacks its `return`.")
    try:
        values = np.asarray(answer, dtype=float)
    except (TypeError, ValueError):
        raise WrongAnswer(f"this is {answer!r}; asked for: {wanted}.") from None
    if values.shape != shape:
        raise WrongAnswer(f"this has the shape {values.shape}; asked for: {wanted}.")
    if not np.isfinite(values).all():
        raise WrongAnswer(
            "some of it is infinite or no number: look for a division by zero, or a negative number under a root."
        )
    return values


def mask(answer: Any, count: int) -> np.ndarray:
    """The answer as True or False for each of `count` particles; raises WrongAnswer."""
    values = np.asarray(answer)
    if values.dtype.kind in "iu" and (values.shape != (count,) or values.max(initial=0) > 1):
        raise WrongAnswer(
            f"these are indices of particles, and a mask is asked for: True or False for each of the {count}."
            f" Make `marked = np.zeros({count}, bool)`, then `marked[indices] = True`."
        )
    if values.dtype != bool:
        raise WrongAnswer(
            f"these are values of type {values.dtype}, and a mask is True or False: compare them with a limit."
        )
    if values.shape != (count,):
        raise WrongAnswer(f"this has the shape {values.shape}; a mask has one value for each of the {count} particles.")
    return values


def called(answer: Any, *given: Any) -> Any:
    """What the answer, a function, gives back; raises WrongAnswer where it is none, fails, or gives nothing back."""
    if not callable(answer):
        raise WrongAnswer(
            f"this is {type(answer).__name__}, and a function is asked for: give its name, without brackets."
        )
    try:
        value = answer(*given)
    except Exception as error:
        raise WrongAnswer(f"your function stops with {type(error).__name__}: {error}.") from None
    if value is None or value is ...:
        raise WrongAnswer(f"{OPEN}, and end the function with `return`.")
    return value


def compare(
    value: Any, right: Any, wrong: Mapping[str, Any], within: float = 1e-6, hint: str = "look at the formula once more."
) -> None:
    """Raise WrongAnswer unless `value` is `right` within a relative error.

    wrong  values that a mistake gives, by what is said of it; `about(value, error)` has a relative error of its own
    hint   what is said where the mistake is not known
    """
    right = np.asarray(right, dtype=float)
    value = numbers(value, right.shape)
    greatest = abs(right).max()

    def near(other: Any, error: float) -> bool:
        return bool((abs(value - other) <= error * (abs(np.asarray(other)).max() or greatest)).all())

    if near(right, within):
        return
    for mistake, other in wrong.items():
        if near(*(other if isinstance(other, Approximate) else (other, within))):
            raise WrongAnswer(mistake)
    share = float((value * right).sum() / (right**2).sum())
    tens = round(np.log10(share)) if share > 0 else 0
    if near(-right, within):
        raise WrongAnswer("the size is right and the sign is wrong.")
    if tens and abs(tens) % 3 == 0 and near(right * 10.0**tens, within):
        raise WrongAnswer(f"this is 1e{tens} times the right answer: look at the units.")
    if right.size > 1 and near(right * share, max(within, 1e-6)):
        raise WrongAnswer(f"all values are {share:.4g} times the right ones: a factor is wrong or missing.")
    raise WrongAnswer(hint)


HELPERS = {"WrongAnswer": WrongAnswer, "about": Approximate} | {
    f.__name__: f for f in (called, compare, mask, number, numbers)
}

# Lessons


HEADER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
BLOCK = re.compile(r"^```(\{code-cell\} )?python\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
JUDGE = re.compile(r"^```\{judge\} (\d+)\n(.*?)^```$\n+", re.MULTILINE | re.DOTALL)
FOLD = "<details><summary>Answer</summary>"
FOLDED = {"cellView": "form", "jupyter": {"source_hidden": True}, "tags": ["hide-input"]}  # Colab, JupyterLab, MyST
INSTALL = """# @title On Colab: install refsim
import importlib.util

if importlib.util.find_spec("refsim") is None:
    %pip install -q refsim"""
KERNEL = {"display_name": "Python 3", "language": "python", "name": "python3"}


class Cell(NamedTuple):
    """A piece of a lesson: its kind, "markdown", "code" or "answer" (code of a folded answer), and its text."""

    kind: str
    text: str


def lessons() -> dict[str, str]:
    """The lessons as markdown, by name, in their order."""
    folder = importlib.resources.files("refsim") / "examples" / "lessons"
    files = (path for path in folder.iterdir() if path.name.endswith(".md"))
    return {path.name.removesuffix(".md"): path.read_text(encoding="utf-8") for path in sorted(files, key=str)}


def title(text: str) -> str:
    """The title of a lesson: its first heading."""
    return next(line.removeprefix("# ") for line in text.splitlines() if line.startswith("# "))


def judges(text: str) -> dict[int, str]:
    """The code that judges answers, by the number of the exercise."""
    return {int(block[1]): block[2] for block in JUDGE.finditer(text)}


def cells(text: str) -> list[Cell]:
    """The pieces of a lesson, in order, without its header and judges."""
    text = HEADER.sub("", JUDGE.sub("", text))
    parts: list[Cell] = []
    place = 0
    for block in BLOCK.finditer(text):
        parts += [Cell("markdown", text[place : block.start()]), Cell("code" if block[1] else "answer", block[2])]
        place = block.end()
    parts.append(Cell("markdown", text[place:]))
    return [cell for cell in parts if cell.text.strip()]


def notebook(text: str, printed: Sequence[str] = ()) -> str:
    """A lesson as a Jupyter notebook: JSON of nbformat 4.5; code of answers is in folded cells.

    printed  what each cell of code has printed, in their order
    """
    pieces, inside = [Cell("answer", INSTALL)], False
    for kind, content in cells(text):
        if kind == "markdown":  # what a fold holds besides code is folded by itself
            content = f"{FOLD}\n{content}" if inside else content
            inside = content.count("<details>") > content.count("</details>")
            content = re.sub(FOLD + r"\s*</details>", "", content + ("\n</details>" if inside else ""))
        elif kind == "answer":
            content = "# @title Worked answer: run it, or unfold and read it\n" + content
        pieces.append(Cell(kind, content))
    made: list[dict[str, Any]] = []
    said = iter(printed)
    for number, (kind, content) in enumerate((piece for piece in pieces if piece.text.strip()), 1):
        cell: dict[str, Any] = {"cell_type": "code", "id": f"cell-{number}", "metadata": {}, "source": content.strip()}
        if kind == "markdown":
            made.append(cell | {"cell_type": "markdown"})
        else:
            content = next(said, "")
            output = [{"name": "stdout", "output_type": "stream", "text": content}] if content else []
            more = {"metadata": FOLDED if kind == "answer" else {}, "execution_count": None, "outputs": output}
            made.append(cell | more)
    about = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    return json.dumps({"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}, indent=1) + "\n"
