"""Verdicts on measured numbers, by bounds that stand with their sources in `expected/<case>.toml`.

One entry a quantity: `what` in words, `unit`, one rule (`at_most`, `at_least`, `equals`, or none: the number is only
shown), the `paper`'s value where it gives one, and the bound's `source`.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PASS, FAIL, SHOWN = "pass", "fail", "shown"
EXPECTED = Path(__file__).parent / "expected"
RULES = {
    "at_most": (lambda value, bound: value <= bound, "at most"),
    "at_least": (lambda value, bound: value >= bound, "at least"),
    "equals": (lambda value, bound: value == bound, "exactly"),
}
_KEYS = {"what", "unit", "paper", "source", *RULES}


@dataclass(frozen=True)
class Measurement:
    """One measured number and the verdict on it.

    name       quantity, with the run after a dot where several runs measure it
    what       the quantity in words
    paper      the paper's value, or "" where it gives none
    tolerance  the bound in words, or ""
    """

    name: str
    what: str
    value: float
    unit: str
    paper: str
    tolerance: str
    verdict: str

    def plain(self) -> dict[str, Any]:
        """What `--json` prints of it; a value that is not finite is null."""
        value = self.value if math.isfinite(self.value) else None
        return {
            "value": value,
            "unit": self.unit,
            "paper": self.paper,
            "tolerance": self.tolerance,
            "verdict": self.verdict,
        }


class Bounds:
    """The bounds of one case; raises ValueError for a file that does not say what it must."""

    def __init__(self, case: str, folder: Path = EXPECTED) -> None:
        path = folder / f"{case}.toml"
        self.case, self.entries = case, tomllib.loads(path.read_text())
        for name, entry in self.entries.items():
            unknown = set(entry) - _KEYS
            rules = [rule for rule in RULES if rule in entry]
            if unknown or len(rules) > 1 or not {"what", "unit", "source"} <= set(entry):
                raise ValueError(f"{path}: [{name}] needs what, unit, source and at most one rule, has {sorted(entry)}")

    def judge(self, name: str, value: float, run: str = "", words: str = "") -> Measurement:
        """Judge one number; `run` and its `words` name which of several runs it comes from. NaN passes no rule."""
        entry = self.entries[name]
        rule = next((rule for rule in RULES if rule in entry), None)
        tolerance, verdict = "", SHOWN
        if rule is not None:
            test, relation = RULES[rule]
            tolerance = f"{relation} {number(entry[rule])}"
            verdict = PASS if test(value, entry[rule]) else FAIL
        what = entry["what"] + (f", {words or run}" if run else "")
        full_name = f"{name}.{run}" if run else name
        return Measurement(
            full_name, what, float(value), entry["unit"], str(entry.get("paper", "")), tolerance, verdict
        )


def number(value: float) -> str:
    """A number with four significant digits, whole numbers in full; "none" for what is not finite."""
    if not math.isfinite(value):
        return "none"
    if isinstance(value, int) or (value == round(value) and abs(value) < 1e6):
        return f"{round(value):,}"
    return f"{value:.4g}"


def failed(measurements: Iterable[Measurement]) -> bool:
    """Whether any verdict is "fail"."""
    return any(m.verdict == FAIL for m in measurements)
