"""Tables as text; bytes and times with their units."""

import io
import math
import sys
import textwrap
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any

NARROW = 16  # letters of words to which a column may shrink
APART = 2  # letters between two columns


def columns() -> float:
    """Width of the terminal that standard output is; infinite where it is none, so that a row stays a line."""
    with suppress(AttributeError, ValueError):  # there is no standard output, or it is closed
        if sys.stdout.isatty():
            import shutil

            return shutil.get_terminal_size().columns
    return math.inf


def fitted(text: str, width: float) -> str:
    """Lines that are wider are wrapped between words; what goes on stands four letters further in."""
    lines = []
    for line in text.split("\n"):
        inner = " " * (len(line) - len(line.lstrip()) + 4)
        whole: dict[str, Any] = {"subsequent_indent": inner, "break_long_words": False, "break_on_hyphens": False}
        lines += (textwrap.wrap(line, int(width), **whole) or [""]) if len(line) > width else [line]
    return "\n".join(lines)


def table(
    rows: Iterable[Sequence[Any]], head: Sequence[str] = (), right: Sequence[int] = (), width: float | None = None
) -> str:
    """Rows in aligned columns; the columns named in `right` are flush right.

    width  at most; that of the terminal by default. Words go on below in their column, and the last columns stand
           below their row where that is too narrow for them.
    """
    lines = [tuple(str(cell) for cell in row) for row in ([head] if head else []) + list(rows)]
    if not lines:
        return ""
    width = columns() if width is None else width
    natural, least = [], []
    for c, cells in enumerate(zip(*lines)):
        natural.append(max(map(len, cells)))
        word = max((len(word) for cell in cells for word in cell.split()), default=0)
        least.append(natural[c] if c in right else max(word, min(natural[c], NARROW)))
    kept = len(natural)
    while kept > 1 and sum(least[:kept]) + APART * (kept - 1) > width:
        kept -= 1
    widths = natural[:kept]
    while sum(widths) + APART * (kept - 1) > width and widths != least[:kept]:
        widths[max(range(kept), key=lambda c: widths[c] - least[c])] -= 1
    if head:
        lines.insert(1, (*("-" * w for w in widths), *[""] * (len(natural) - kept)))
    if widths != natural:
        return _narrow(lines, widths, right, int(width))
    put = [str.rjust if c in right else str.ljust for c in range(kept)]
    between = " " * APART
    return "\n".join(between.join(f(cell, w) for f, cell, w in zip(put, line, widths)).rstrip() for line in lines)


def _narrow(lines: Sequence[Sequence[str]], widths: Sequence[int], right: Sequence[int], width: int) -> str:
    """Rows of which some need several lines, drawn by Rich; cells without a column of their own stand below."""
    from rich.console import Console
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    written = io.StringIO()
    drawn = Console(file=written, width=width, color_system=None, legacy_windows=False)
    for line in lines:
        grid = Table.grid(padding=(0, APART, 0, 0))
        for c, w in enumerate(widths):
            grid.add_column(width=w, justify="right" if c in right else "left")
        grid.add_row(*map(Text, line[: len(widths)]))
        drawn.print(grid, *(Padding(Text(cell), (0, 0, 0, 4)) for cell in line[len(widths) :] if cell), sep="")
    return "\n".join(row.rstrip() for row in written.getvalue().splitlines())


def vector(numbers: Iterable[float], digits: str = "") -> str:
    """Numbers in parentheses, of six digits or as `digits` has them, such as ".3"."""
    return f"({', '.join(f'{x:{digits}g}' for x in numbers)})"


def in_bytes(count: float) -> str:
    """A number of bytes as text with its unit."""
    for unit in ("B", "KiB", "MiB", "GiB"):
        if count < 1024 or unit == "GiB":
            return f"{count:.0f} {unit}" if unit == "B" else f"{count:.1f} {unit}"
        count /= 1024
    raise AssertionError


def in_time(seconds: float) -> str:
    """A time span as text with its unit."""
    if seconds < 100:
        return f"{seconds:.3g} s"
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s"


class Shown:
    """Shows itself as a table of facts."""

    def _summary(self) -> tuple[str, list[tuple[str, str]]]:
        """Title, and (what, its value in words)."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, rows = self._summary()
        return f"{title}\n{table(rows)}"
