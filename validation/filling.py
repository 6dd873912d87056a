"""Numbers on pages and in reasons come from records: claims and the data of pictures.

A page marks a number as `<!-- {TEMPLATE} -->number<!-- . -->`. A template is one of `str.format`: it names claims
(`low`, `high`, `median`, `starts`, `keeping`, `values`) and the data of pictures (`picture[name][key]`); a number has
`percent`, `less` (percent below 1) and `more` (percent above 1). `{own_drop_round.high.more:.1g}` is one.
`origin[name]` is the day, commit and machine of a picture's data.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from validation.checks import CLAIM, Entry, number
from validation.drawing import read_data, read_origin

ROOT = Path(__file__).resolve().parent.parent
MARKED = re.compile(r"<!-- (\{[^{}]*\}) -->.*?<!-- \. -->")


class Number(float):
    """A number of a record; three significant digits without a format of its own."""

    @property
    def percent(self) -> Number:
        """In percent."""
        return Number(100 * self)

    @property
    def less(self) -> Number:
        """How many percent it is below 1."""
        return Number(100 * (1 - self))

    @property
    def more(self) -> Number:
        """How many percent it is above 1."""
        return Number(100 * (self - 1))

    @property
    def inverse(self) -> Number:
        """One over it."""
        return Number(math.inf if self == 0 else 1 / self)

    @property
    def size(self) -> Number:
        """Without its sign."""
        return Number(abs(self))

    def __format__(self, form: str) -> str:
        if not math.isfinite(self):
            return "infinite" if math.isinf(self) else "undefined"
        return float.__format__(self, form) if form else number(float(f"{self:.3g}"))


def numbers(value: Any) -> Any:
    """Plain values with every number as a `Number`; None, which JSON has for it, is infinite."""
    if isinstance(value, Mapping):
        return {key: numbers(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [numbers(each) for each in value]
    if value is None:
        return Number(math.inf)
    return Number(value) if isinstance(value, float | int) and not isinstance(value, bool) else value


class RecordedClaim:
    """What a template may name of a claim."""

    def __init__(self, entry: Entry, values: Sequence[float | None]) -> None:
        self.median, self.low, self.high = map(Number, (entry.measured, *entry.spread))
        self.starts, self.values = entry.starts, numbers(list(values))
        self.keeping = sum(map(entry.keeps, self.values))


class Pictures(dict[str, Any]):
    """Data of pictures by name, each read once, when first needed."""

    def __missing__(self, name: str) -> Any:
        self[name] = numbers(read_data(ROOT / "figures", name))
        return self[name]


class Origins(dict[str, str]):
    """Day, commit and machine of the data of pictures by name."""

    def __missing__(self, name: str) -> str:
        origin = read_origin(ROOT / "figures", name)
        machine = origin["machine"]
        return f"{origin['date']}, commit {origin['commit'][:8]}, {machine.get('gpu') or machine['processor']}"


def stored() -> dict[str, dict[str, Any]]:
    """What was measured of each claim: its values, one for each start (null is infinite), and where."""
    path = ROOT / "figures" / "claims.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def records(entries: Iterable[Entry]) -> dict[str, RecordedClaim]:
    """What templates may name of the claims."""
    kept = stored()
    return {e.name: RecordedClaim(e, kept.get(e.name, {"values": []})["values"]) for e in entries if e.kind == CLAIM}


def with_reasons(entries: Sequence[Entry]) -> list[Entry]:
    """The entries with the numbers in their reasons, where they have been measured."""
    known, made = records(entries), []
    for entry in entries:
        with contextlib.suppress(ValueError):  # a start has been added, and is not measured yet
            entry = dataclasses.replace(entry, reason=filled(entry.reason, known, known.get(entry.name)))
        made.append(entry)
    return made


def replaced(text: str, name: str, lines: Sequence[str], page: Path) -> str:
    """The page with other lines between the marks of the part. Raises ValueError where the marks are missing."""
    begin, end = f"<!-- {name} -->\n", f"\n<!-- end of {name} -->"
    before, mark, rest = text.partition(begin)
    _, last, after = rest.partition(end)
    if not mark or not last:
        raise ValueError(f"{page.name} lacks the lines {begin.strip()!r} and {end.strip()!r}")
    return f"{before}{begin}\n" + "\n".join(lines) + f"\n{end}{after}"


def filled(template: str, records: Mapping[str, RecordedClaim], own: RecordedClaim | None = None) -> str:
    """A text with its numbers. Raises ValueError for a template that names what is not there."""
    names = {**records, **({} if own is None else vars(own)), "picture": Pictures(), "origin": Origins()}
    try:
        return template.format_map(names)
    except (KeyError, IndexError, AttributeError, TypeError, OSError) as error:
        raise ValueError(f"{template!r} names what no record holds ({error!r})") from None


def filled_page(text: str, records: Mapping[str, RecordedClaim]) -> str:
    """A page with the numbers of the records."""
    return MARKED.sub(lambda found: f"<!-- {found[1]} -->{filled(found[1], records)}<!-- . -->", text)
