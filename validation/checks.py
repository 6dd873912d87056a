"""Checks: numbers that runs gave, held against the bars of their experiment.

The bars stand in `experiments/<experiment>/expected.toml`, one table a quantity, under its kind: `[verdict.NAME]`,
`[claim.NAME]` (`validation.claims`), `[hard_case.NAME]` (`validation.stability`) and `[accuracy.NAME]`. A verdict and
an accuracy point have `what` in words, `unit`, at most one rule (`at_most`, `at_least`, `equals`; without one the
number is only shown), the value in the `paper` where it gives one, and the bar's `source`.
"""

from __future__ import annotations

import functools
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from validation.results import real

VERDICT, CLAIM, HARD_CASE, ACCURACY = "verdict", "claim", "hard_case", "accuracy"
KINDS = (VERDICT, CLAIM, HARD_CASE, ACCURACY)
PASS, FAIL, SHOWN = "pass", "fail", "shown"
FOLDER = Path(__file__).parent / "experiments"
RULES = {
    "at_most": (lambda value, bar: value <= bar, "at most"),
    "at_least": (lambda value, bar: value >= bar, "at least"),
    "equals": (lambda value, bar: value == bar, "exactly"),
}
_KEYS = {"what", "unit", "paper", "source", *RULES}


@dataclass(frozen=True)
class Check:
    """One quantity that was measured, and the verdict on it.

    name     quantity, with the run after a dot where several runs measure it
    what     the quantity in words
    paper    the paper's value, or "" where it gives none
    bar      the bar in words, or ""
    verdict  PASS, FAIL or SHOWN
    """

    name: str
    what: str
    value: float
    unit: str
    paper: str
    bar: str
    verdict: str

    def plain(self) -> dict[str, Any]:
        """What `--json` prints of it; a value that is not finite is null."""
        value = self.value if math.isfinite(self.value) else None
        return {"value": value, "unit": self.unit, "paper": self.paper, "bar": self.bar, "verdict": self.verdict}


def expected(experiment: str, kind: str, folder: Path | None = None) -> Mapping[str, Mapping[str, Any]]:
    """The entries of one kind by name; none where the experiment has no file. Raises ValueError for other kinds."""
    return read_expected((folder or FOLDER) / experiment / "expected.toml").get(kind, {})


@functools.cache
def read_expected(path: Path) -> Mapping[str, Mapping[str, Any]]:
    """The entries of a file by kind and name; none without the file."""
    entries = tomllib.loads(path.read_text()) if path.exists() else {}
    if unknown := set(entries) - set(KINDS):
        raise ValueError(f"{path}: there is no kind {sorted(unknown)}; choose from {', '.join(KINDS)}")
    return entries


def bars(experiment: str, kind: str = VERDICT, folder: Path | None = None) -> Mapping[str, Mapping[str, Any]]:
    """The bars of an experiment's verdicts or accuracy points. Raises ValueError for one that is not complete."""
    entries = expected(experiment, kind, folder)
    for name, entry in entries.items():
        if set(entry) - _KEYS or len(_rules(entry)) > 1 or not {"what", "unit", "source"} <= set(entry):
            raise ValueError(
                f"{experiment}: [{kind}.{name}] needs what, unit, source and at most one rule, has {sorted(entry)}"
            )
    return entries


def _rules(entry: Mapping[str, Any]) -> list[str]:
    return [rule for rule in RULES if rule in entry]


class Checks:
    """Holds numbers against the bars of an experiment, and keeps the checks in their order (`made`)."""

    def __init__(self, experiment: str, kind: str = VERDICT, folder: Path | None = None) -> None:
        self.bars, self.made = bars(experiment, kind, folder), list[Check]()

    def __call__(self, name: str, value: float | None, run: str = "", words: str = "") -> Check:
        """Check one number; `run` and its `words` name the run that it comes from. None and NaN pass no rule."""
        entry, value = self.bars[name], real(value)
        bar, verdict = "", SHOWN
        for rule in _rules(entry):
            test, relation = RULES[rule]
            bar = f"{relation} {number(entry[rule])}"
            verdict = PASS if test(value, entry[rule]) else FAIL
        what = entry["what"] + (f", {words or run}" if run else "")
        paper = str(entry.get("paper", ""))
        self.made.append(Check(f"{name}.{run}" if run else name, what, value, entry["unit"], paper, bar, verdict))
        return self.made[-1]


def number(value: float) -> str:
    """A number with four significant digits, whole numbers in full; "none" for what is not finite."""
    if not math.isfinite(value):
        return "none"
    if isinstance(value, int) or (value == round(value) and abs(value) < 1e6):
        return f"{round(value):,}"
    return f"{value:.4g}"


def failed(checks: Iterable[Check]) -> bool:
    """Whether any check failed."""
    return any(check.verdict == FAIL for check in checks)
