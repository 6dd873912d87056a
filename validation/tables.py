"""Tables as aligned text: words to the left, numbers to the right."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from refsim.core.tables import table
from validation.checks import number
from validation.results import Result

ACROSS = 8  # columns of a table of values


@dataclass(frozen=True)
class Table:
    """A table beside the verdicts: cells are words, numbers (four digits) or None (a dash)."""

    title: str
    heading: Sequence[str]
    rows: Sequence[Sequence[str | float | int | None]]
    note: str = ""

    def __str__(self) -> str:
        return self.text(math.inf)

    def text(self, width: float) -> str:
        """Its lines, at most so wide."""
        cells = [["-" if c is None else c if isinstance(c, str) else number(c) for c in row] for row in self.rows]
        numbers = [k for k in range(len(self.heading)) if any(isinstance(row[k], float | int) for row in self.rows)]
        lines = [self.title, table(cells, self.heading, numbers, width)]
        return "\n".join([*lines, self.note] if self.note else lines)


def of_values(results: Mapping[str, Result]) -> list[Table]:
    """What runs gave: a row a run, a column a number or words; runs that give the same have a table together."""
    alike: dict[tuple[str, ...], list[tuple[str, dict[str, Any]]]] = {}
    for key, result in results.items():
        row = dict(_plain(result.values))
        alike.setdefault(tuple(row), []).append((key, row))
    made = []
    for names, rows in alike.items():
        for some in (names[k : k + ACROSS] for k in range(0, len(names), ACROSS)):
            made.append(Table("Values of runs", ["run", *some], [[key, *(row[n] for n in some)] for key, row in rows]))
    return made


def _plain(values: Mapping[str, Any], before: str = "", deeper: bool = True) -> Iterator[tuple[str, Any]]:
    """(name, value) of the numbers and words among the values, and among the mappings in them."""
    for name, value in values.items():
        if isinstance(value, Mapping) and deeper:
            yield from _plain(value, f"{before}{name}.", deeper=False)
        elif value is None or isinstance(value, str | int | float):
            yield f"{before}{name}", value
