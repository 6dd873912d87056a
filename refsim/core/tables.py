"""Tables as text, as HTML for notebooks and as pandas' frames; bytes and times with their units."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from refsim.core.checked import suggestion
from refsim.core.errors import InputError
from refsim.core.extras import extra


class UnknownRow(InputError, KeyError):
    """A table has no row of that name; a KeyError, too, so that `in` and `get` work as in every mapping."""

    __str__ = Exception.__str__


def table(rows: Iterable[Sequence[Any]], head: Sequence[str] = (), right: Sequence[int] = ()) -> str:
    """Rows in aligned columns; the columns named in `right` are flush right."""
    lines = [tuple(str(cell) for cell in row) for row in ([head] if head else []) + list(rows)]
    if not lines:
        return ""
    widths = [max(len(line[c]) for line in lines) for c in range(len(lines[0]))]
    text = [
        "  ".join(cell.rjust(w) if c in right else cell.ljust(w) for c, (cell, w) in enumerate(zip(line, widths)))
        for line in lines
    ]
    if head:
        text.insert(1, "  ".join("-" * w for w in widths))
    return "\n".join(line.rstrip() for line in text)


def html_table(title: str, rows: Iterable[Sequence[Any]], head: Sequence[str] = ()) -> str:
    """The rows as an HTML table with a title above it."""
    import html

    def line(cells: Sequence[Any], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    lines = [line(head, "th")] if head else []
    lines += [line(row, "td") for row in rows]
    return f"<p><b>{html.escape(title)}</b></p><table>{''.join(lines)}</table>"


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
    """Shows itself as a table of facts, as text and in notebooks."""

    def _facts(self) -> tuple[str, list[tuple[str, str]]]:
        """Title, and (what, its value in words)."""
        raise NotImplementedError

    def __repr__(self) -> str:
        title, rows = self._facts()
        return f"{title}\n{table(rows)}"

    def _repr_html_(self) -> str:
        return html_table(*self._facts())


class Table(Mapping[str, Any]):
    """Rows under columns; the first column names the rows.

    columns  their names
    rows     one tuple a row

    `table["mass"]` is the value of the row named mass, or, with several columns of values, the values by column;
    `table["search"]` is the table of the rows named "search.rebuilds" and the like. Raises UnknownRow (an InputError
    and a KeyError) for another name.
    """

    def __init__(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
        self.title = title
        self.columns = tuple(columns)
        self.rows = tuple(map(tuple, rows))
        self._places = {str(row[0]): k for k, row in enumerate(self.rows)}

    def __getitem__(self, name: str) -> Any:
        if name not in self._places:
            inner = [(row[0].removeprefix(f"{name}."), *row[1:]) for row in self.rows if row[0].startswith(f"{name}.")]
            if not inner:
                raise UnknownRow(f"{self.title}: there is no row {name!r}; {suggestion(name, self._places)}")
            return Table(f"{self.title}, {name}", self.columns, inner)
        values = dict(zip(self.columns, self.rows[self._places[name]]))
        del values[self.columns[0]]
        return values if len(values) > 1 else values[self.columns[1]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)

    def _shown(self) -> list[tuple[str, ...]]:
        return [tuple(f"{c:.6g}" if isinstance(c, float) else str(c) for c in row) for row in self.rows]

    def __repr__(self) -> str:
        return table(self._shown(), self.columns)

    def _repr_html_(self) -> str:
        return html_table(self.title, self._shown(), self.columns)

    def to_pandas(self) -> Any:
        """The table as a pandas.DataFrame, indexed by the first column (extra "results")."""
        pandas = extra("pandas", "Table.to_pandas")
        return pandas.DataFrame(self.rows, columns=list(self.columns)).set_index(self.columns[0])
