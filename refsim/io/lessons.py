"""Lessons: text notebooks in MyST markdown, in the package, and the same as Jupyter notebooks and Python scripts.

A lesson is a markdown file with a header. Blocks fenced as `{code-cell}` are executed in order, in one namespace.
Blocks fenced as `python` stand in folded answers (`<details>`); tests execute them, too, at their place in the order.
"""

import importlib.resources
import json
import re
from typing import Any, NamedTuple

HEADER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)
BLOCK = re.compile(r"^```(\{code-cell\} )?python\n(.*?)^```$\n?", re.MULTILINE | re.DOTALL)
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


def cells(text: str) -> list[Cell]:
    """The pieces of a lesson, in order, without its header."""
    text = HEADER.sub("", text)
    found: list[Cell] = []
    place = 0
    for block in BLOCK.finditer(text):
        found += [Cell("markdown", text[place : block.start()]), Cell("code" if block[1] else "answer", block[2])]
        place = block.end()
    found.append(Cell("markdown", text[place:]))
    return [cell for cell in found if cell.text.strip()]


def _shown(text: str) -> list[Cell]:
    """Markdown and code; the code of an answer stays in the markdown, where it is folded."""
    found: list[Cell] = []
    for kind, words in cells(text):
        if kind == "code":
            found.append(Cell(kind, words))
            continue
        if kind == "answer":
            words = f"```python\n{words}```\n"
        if found and found[-1].kind == "markdown":
            words = found.pop().text + words
        found.append(Cell("markdown", words))
    return found


def notebook(text: str) -> str:
    """A lesson as a Jupyter notebook: JSON of nbformat 4.5, without outputs."""
    made: list[dict[str, Any]] = []
    for number, (kind, words) in enumerate(_shown(text), 1):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}, "source": words.strip()}
        made.append(cell | {"execution_count": None, "outputs": []} if kind == "code" else cell)
    about = {"kernelspec": KERNEL, "language_info": {"name": "python"}}
    return json.dumps({"cells": made, "metadata": about, "nbformat": 4, "nbformat_minor": 5}, indent=1) + "\n"


def script(text: str) -> str:
    """A lesson as a Python script in percent format, which runs with `python` and opens in editors as a notebook."""
    parts = []
    for kind, words in _shown(text):
        if kind == "code":
            parts.append(f"# %%\n{words.strip()}\n")
        else:
            lines = "\n".join(f"# {line}".rstrip() for line in words.strip().splitlines())
            parts.append(f"# %% [markdown]\n{lines}\n")
    return "\n".join(parts)
