"""Lessons: text notebooks in MyST markdown, in the package, and the same as Jupyter notebooks and Python scripts.

A lesson is a markdown file with a header. Blocks fenced as `{code-cell}` are executed in order, in one namespace.
Blocks fenced as `python` stand in folded answers (`<details>`); they are folded cells of the notebook. Blocks fenced as
`{judge} N` judge answers to exercise N (`refsim.io.exercises`), and no form of the lesson shows them.
"""

import importlib.resources
import json
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

HEADER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
BLOCK = re.compile(r"^```(\{code-cell\} )?python\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
CELL = re.compile(r"^```\{code-cell\} python\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
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


def shown(text: str) -> str:
    """The text of a lesson as its reader gets it, without the judges."""
    return JUDGE.sub("", text)


def cells(text: str) -> list[Cell]:
    """The pieces of a lesson, in order, without its header and judges."""
    text = HEADER.sub("", shown(text))
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


def script(text: str) -> str:
    """A lesson as a Python script in percent format, which runs with `python` and opens in editors as a notebook.

    Answers are comments.
    """
    parts = []
    for number, cell in enumerate(CELL.split(HEADER.sub("", shown(text)))):
        if number % 2:
            parts.append(f"# %%\n{cell.strip()}\n")
        elif cell.strip():
            lines = "\n".join(f"# {line}".rstrip() for line in cell.strip().splitlines())
            parts.append(f"# %% [markdown]\n{lines}\n")
    return "\n".join(parts)
