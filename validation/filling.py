"""Numbers on pages and in reasons come from records: claims and the data of pictures.

A page marks a number as `<!-- {TEMPLATE} -->number<!-- . -->`. A template is one of `str.format`: it names claims
(`low`, `high`, `median`, `starts`, `keeping`, `values`) and the data of pictures (`picture[name][key]`); a number has
`percent`, `less` (percent below 1) and `more` (percent above 1). `{own_drop_round.high.more:.1g}` is one. In a row of a
table whose last cell names claims, the cell before is written from them.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from validation.checks import number
from validation.drawing import read_data

ROOT = Path(__file__).resolve().parent.parent
MARKED = re.compile(r"<!-- (\{[^{}]*\}) -->.*?<!-- \. -->")
NAMED = re.compile(r"`\w+`(?:, `\w+`)*")


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


class Recorded:
    """What a template may name of a claim."""

    def __init__(
        self, measured: float, spread: Sequence[float], starts: int, values: Sequence[float | None],
        keeps: Callable[[float], bool],
    ) -> None:  # fmt: skip
        self.median, self.low, self.high = Number(measured), Number(spread[0]), Number(spread[1])
        self.starts, self.values = starts, numbers(list(values))
        self.keeping = sum(map(keeps, self.values))


class Pictures(dict[str, Any]):
    """Data of pictures by name, each read once, when first needed."""

    def __missing__(self, name: str) -> Any:
        self[name] = numbers(read_data(ROOT / "figures", name))
        return self[name]


def stored_values() -> dict[str, list[float | None]]:
    """The values of all claims, one for each start; null is infinite."""
    path = ROOT / "figures" / "claims.json"
    return {name: each["values"] for name, each in json.loads(path.read_text()).items()} if path.exists() else {}


def filled(template: str, records: Mapping[str, Recorded], own: Recorded | None = None) -> str:
    """A text with its numbers. Raises ValueError for a template that names what is not there."""
    names = {**records, **({} if own is None else vars(own)), "picture": Pictures()}
    try:
        return template.format_map(names)
    except (KeyError, IndexError, AttributeError, TypeError, OSError) as error:
        raise ValueError(f"{template!r} names what no record holds ({error!r})") from None


def filled_page(text: str, records: Mapping[str, Recorded], finding: Callable[[str], str]) -> str:
    """A page with the numbers and findings of the records. `finding` tells what was found of a claim."""
    text = MARKED.sub(lambda found: f"<!-- {found[1]} -->{filled(found[1], records)}<!-- . -->", text)
    return "\n".join(_row(line, records, finding) for line in text.split("\n"))


def _row(line: str, records: Mapping[str, Recorded], finding: Callable[[str], str]) -> str:
    cells = line.strip().removeprefix("| ").removesuffix(" |").split(" | ")
    if not line.startswith("| ") or len(cells) < 3 or not NAMED.fullmatch(cells[-1]):
        return line
    names = re.findall(r"\w+", cells[-1])
    if not set(names) <= set(records):
        return line
    cells[-2] = "<br>".join(dict.fromkeys(map(finding, names)))
    return f"| {' | '.join(cells)} |"
