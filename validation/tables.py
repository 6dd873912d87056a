"""Tables as aligned text: words to the left, numbers to the right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from validation.checks import number


@dataclass(frozen=True)
class Table:
    """A table beside the verdicts: cells are words, numbers (four digits) or None (a dash)."""

    title: str
    heading: Sequence[str]
    rows: Sequence[Sequence[str | float | int | None]]
    note: str = ""

    def __str__(self) -> str:
        cells = [["-" if c is None else c if isinstance(c, str) else number(c) for c in row] for row in self.rows]
        right = [
            any(not isinstance(row[k], str) and row[k] is not None for row in self.rows)
            for k in range(len(self.heading))
        ]
        lines = [self.title, *aligned([list(self.heading), *cells], right)]
        return "\n".join([*lines, self.note] if self.note else lines)


def aligned(rows: Sequence[Sequence[str]], right: Sequence[bool]) -> list[str]:
    """Lines of a table whose first row is the heading; `right` says which columns stand to the right."""
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]

    def line(row: Sequence[str]) -> str:
        parts = [c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right)]
        return "  ".join(parts).rstrip()

    return [line(rows[0]), "  ".join("-" * w for w in widths), *map(line, rows[1:])]
