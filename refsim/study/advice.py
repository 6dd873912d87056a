"""What an accuracy costs in the panels: the cheapest measured setting for any error.

1. The error of a setting is the largest of it and of all finer ones: those with the same other knobs whose spacing and
   step are no larger, on any machine and in any precision. Errors of opposite sign cancel at one spacing and not at the
   next; a setting that stops has an infinite error. The uncertainty of the reference is added.
2. Of the settings within the error the one of the least seconds is advised. They are those of the whole run that its
   scene makes, whatever the error.
3. float64 is advised only where float32 with the same knobs is not within the error.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from refsim.core.tables import in_bytes
from refsim.study.panels import OWN, Panel, Point
from refsim.study.result import percent

READINGS = 5  # of a setting's seconds
FINE = ("spacing", "step")  # knobs of which less is finer
SCATTER = 0.05  # interquartile range over the median, from which on seconds are told with their range


def _finer(of: Panel, point: Point) -> Iterator[Point]:
    """The point wherever it ran, and all that differ from it in a smaller spacing or step, whatever their precision."""
    for other in of.points.values():
        if other.place >= 0 and other.program == point.program and _physics(other) == _physics(point):
            theirs, ours = ([p.knobs.get(name, 0.0) for name in FINE] for p in (other, point))
            alike = theirs == ours and other.knobs["dtype"] == point.knobs["dtype"]
            if alike or (theirs != ours and all(a <= b for a, b in zip(theirs, ours))):
                yield other


def _physics(point: Point) -> dict[str, Any]:
    """The knobs of which more or less is no finer."""
    return {name: value for name, value in point.knobs.items() if name not in (*FINE, "backend", "dtype")}


def settings(of: Panel, kind: str) -> list[tuple[float, Point]]:
    """The panel's points of a kind ("cpu", "gpu" or "peer") that were measured and came to an end, with the largest
    errors that they may have (rule 1), the cheapest first.
    """
    known = of.reference().uncertainty
    kinds = {key: "peer" if p.program != OWN else "gpu" if p.gpu else "cpu" for key, p in of.points.items()}
    judged = (p for key, p in of.points.items() if kinds[key] == kind and p.place >= 0 and not p.failed)
    return sorted(((max(map(of.error, _finer(of, p))) + known, p) for p in judged), key=lambda pair: price(pair[1]))


def price(point: Point) -> float:
    """Median seconds of a run."""
    return float(np.median(point.seconds))


def cheapest(of: Panel, error: float, kind: str = "cpu") -> tuple[float, Point] | None:
    """(error, setting) of the cheapest one within a relative error; None where none is (rules 2 and 3)."""
    within = [pair for pair in settings(of, kind) if pair[0] <= error]
    single = [p.knobs for _, p in within if p.knobs.get("dtype") == "float32"]
    needed = (pair for pair in within if pair[1].knobs in single or {**pair[1].knobs, "dtype": "float32"} not in single)
    return next(needed, None)


def least(of: Panel, kind: str = "cpu", seconds: float = np.inf) -> tuple[float, Point] | None:
    """(error, setting) of the least error within so many seconds; None where none is that fast."""
    within = [pair for pair in settings(of, kind) if price(pair[1]) <= seconds]
    return min(within, key=lambda pair: pair[0], default=None)


def scattered(seconds: Sequence[float]) -> bool:
    """Whether readings of the same work differ by more than a median can tell."""
    low, middle, high = np.quantile(seconds, (0.25, 0.5, 0.75))
    return bool(high - low >= SCATTER * middle)


def duration(seconds: Sequence[float]) -> str:
    """Median of seconds in words, three digits; their range where they scatter."""
    span = f" ({_span(min(seconds))} to {_span(max(seconds))})" if scattered(seconds) else ""
    return _span(float(np.median(seconds))) + span


def _span(seconds: float) -> str:
    unit, size = ("s", 1.0) if seconds >= 1 else ("ms", 1e-3) if seconds >= 1e-3 else ("us", 1e-6)
    return f"{seconds / size:.3g} {unit}"


def in_words(of: Panel, error: float) -> str:
    """An error in per cent, and in the observable's own unit, where its number is another one."""
    about, scale = of.about, of.reference().scale
    shown = about.unit and about.unit != "%" and (about.limit_of or scale > 1)
    return percent(error) + (f" ({error * scale:.2g} {about.unit})" if shown else "")


def text_of(of: Panel, error: float, kind: str, sufficient: tuple[float, Point] | None) -> str:
    """The answer as text."""
    about, uncertainty, nearest = of.about, of.reference().uncertainty, least(of, kind)
    lines = [f"{about.words}: an error of {percent(error)} {about.relative}"]
    if error <= uncertainty:
        return f"{lines[0]}\n  no meaning: the reference is known to {percent(uncertainty)} ({about.uncertain})"
    if nearest is None:
        return f"{lines[0]}\n  not measured on a {kind.upper()}"
    if sufficient is None:
        lines.append("  not reached; the least error has:")
    bound, point = sufficient or nearest
    lines.append(f"  setting    {point.words}; error at most {in_words(of, bound)}")
    lines.append(f"  measured   {duration(point.seconds)} on {of.where(point)}")
    if point.bytes:
        lines.append(f"  memory     {in_bytes(point.bytes)} in fields")
    if kind == "cpu" and (other := cheapest(of, error, "peer") or least(of, "peer")) is not None:
        reached = "" if other[0] <= error else f", which has {percent(other[0])} at best"
        lines.append(f"  others     {duration(other[1].seconds)}, {other[1].words}{reached}")
    return "\n".join([*lines, *(f"  note       {note}" for note in (about.remark,) if note)])


def data_of(of: Panel, error: float, kind: str, sufficient: tuple[float, Point] | None) -> dict[str, Any]:
    """The answer as plain values."""

    answers = {"answer": sufficient, "nearest": least(of, kind), "peer": cheapest(of, error, "peer")}
    told = {
        name: pair and {
            "key": pair[1].key, "setting": pair[1].words, "program": pair[1].program, "error": pair[0],
            "seconds": price(pair[1]), "bytes": pair[1].bytes, "measured_on": of.where(pair[1]),
        } for name, pair in answers.items()
    }  # fmt: skip
    return {
        "observable": of.name, "words": of.about.words, "relative": of.about.relative,
        "reference": of.about.reference, "uncertainty": of.reference().uncertainty, "error": error,
        "backend": "cuda" if kind == "gpu" else "cpu", **told, "scene": None,
    }  # fmt: skip
