"""Checks: what stands on file, what a run gave, and the one judgement between them.

A check is an entry `[check.NAME]` of an experiment's `expected.toml`. It has a `kind`, says `what` is measured, and has
the `source` of its bar and at most one rule (`at_most`, `at_least`, `equals`). Its `reason` says what a reader must
know beside the number; numbers in it are templates (`validation.filling`). The kinds:

verdict    a quantity of a run, passes its bar or fails; shown without one. With `misses = true` its bar is known to be
           missed: `missed` if so, and a fail if it is kept
claim      a reading of a `[sentence.NAME]` of a source; confirmed if every start keeps the bar, refuted if none does,
           else mixed. A reading that differs from what the source states is an own reading, and what the source does
           not say is not claimed: kept, missed or mixed
hard case  a scene that breaks codes, and how it ends: a `Trial` (`validation.trials`)
value      a published number of a single run, with its spread

A `[sentence.NAME]` is what a source says: its `system`, its `place` (section, paragraph, sentence), key `words` of the
original, what it `says` in English, and the `parameters` that the source gives. Claims of any experiment name it.
Claims that are measured alike are a `[family.NAME]`, which says how they could have failed; `[map.NAME]` are the words
of a map of what is stable.
"""

import fnmatch
import functools
import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from validation.results import Result, real

VERDICT, CLAIM, HARD_CASE, VALUE = KINDS = ("verdict", "claim", "hard case", "value")
PASS, FAIL, SHOWN, MISSED = "pass", "fail", "shown", "missed"
CONFIRMED, REFUTED, MIXED, NOT_TESTABLE = "confirmed", "refuted", "mixed", "not testable"
OWN_READING, NOT_CLAIMED = "own reading", "not claimed"  # followed by how it went, as in "own reading: kept"
WENT = {CONFIRMED: "kept", REFUTED: "missed", MIXED: "mixed", NOT_TESTABLE: NOT_TESTABLE}
VERDICTS = (CONFIRMED, REFUTED, MIXED, NOT_TESTABLE, OWN_READING, NOT_CLAIMED)
WARNED, REFUSED, STOPPED, FAILS = "warned", "refused", "stopped", "fails"  # how a hard case ends that does not pass
Quantities = Mapping[str, str | Callable[[Mapping[str, Any]], float | None]]
STARTS = 5  # least number, unless the claim says why nothing can differ (`fixed`) or that these are all (`complete`)
FEW = 3  # least number where they are all that there are
DIGITS = 1e-3  # relative; twice the rounding of a number with four digits
FOLDER = Path(__file__).parent / "experiments"
RULES = {
    "at_most": (lambda value, bar: value <= bar, "at most"),
    "at_least": (lambda value, bar: value >= bar, "at least"),
    "equals": (lambda value, bar: value == bar, "exactly"),
}
_MEASURED = {"what", "unit", "measured", "spread", "starts", "over"}
KEYS: dict[str, tuple[set[str], set[str]]] = {  # by kind: what an entry needs, and what else it may have
    VERDICT: ({"what", "unit", "source"}, {"paper", "reason", "misses", "run", "quantity", *RULES}),
    CLAIM: (
        {"sentence", "title", "reading", "verdict"},
        {*_MEASURED, "null", "reason", "fixed", "complete", "verify", *RULES},
    ),
    HARD_CASE: ({"what", "holds", "trial", "verdict"}, {"given", "short", "seconds", "reason"}),
    VALUE: ({"what", "unit", "source", "run", "quantity", "measured", "spread"}, {"reason"}),
}


@dataclass(frozen=True)
class Sentence:
    """What a source says in one place, as it stands in a `[sentence.NAME]`; all sentences share one space of names.

    system      whose it is
    place       section, paragraph and sentence; a formula and the words that explain it belong to the paragraph before
    words       some characters of the original, by which a reader finds it
    says        the same in English
    parameters  what the source gives of the numbers that it depends on
    """

    name: str
    system: str
    place: str
    words: str
    says: str
    parameters: str


@dataclass(frozen=True)
class Entry:
    """One check as it stands on file.

    experiment  in whose folder it stands, or another one of that folder, which the entry names; its name begins the
              check's own then, as in `[check.wetting_span]`
    what      the quantity in words; of a hard case what is hard
    source    where the bar, the sentence or the spread comes from
    rule      at_most, at_least or equals, or ""; bound: its number
    reason    what a reader must know beside the number; why a claim cannot be tested, or a hard case does not pass
    verdict   on file, of claims and hard cases
    measured  of claims and values: median over the starts (seeds, sizes, states); spread: least and largest
    starts    how many; over: what they are, in the plural; complete: whether these are all that there are
    fixed     why nothing can differ between starts, where there is one
    null      the same quantity of the null model of the claim's family
    verify    "number" or "verdict": what of a claim `python -m validation verify` compares
    misses    the bar is known to be missed
    sentence  of a claim: what the source says; title: what is judged of it; reading: how it is read
    holds     of a hard case: what must hold; trial, given: function of the experiment and its arguments;
              short: it takes a second or so; seconds: that it may take
    run, quantity   of a value: where it comes from, `values[quantity]` of the run of that key; of a verdict the keys of
              its runs, with * and ?, apart by spaces, and the quantity if that is not the check's name
    """

    name: str
    experiment: str
    kind: str
    what: str = ""
    unit: str = "-"
    source: str = ""
    paper: str = ""
    rule: str = ""
    bound: float = math.nan
    reason: str = ""
    verdict: str = ""
    measured: float = math.nan
    spread: tuple[float, float] = (math.nan, math.nan)
    starts: int = 0
    over: str = ""
    complete: bool = False
    fixed: str = ""
    null: float = math.nan
    verify: str = ""
    misses: bool = False
    sentence: Sentence | None = None
    title: str = ""
    reading: str = ""
    holds: str = ""
    trial: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)
    short: bool = False
    seconds: float = 1.0
    run: str = ""
    quantity: str = ""

    @property
    def system(self) -> str:
        """Whose claim it is; "" of other checks."""
        return self.sentence.system if self.sentence else ""

    @property
    def word(self) -> str:
        """The verdict on file in one word or two."""
        return self.verdict.partition(":")[0]

    def keeps(self, value: float) -> bool:
        """Whether a value keeps the bar; NaN does not."""
        return bool(RULES[self.rule][0](value, self.bound))

    def bar(self) -> str:
        """The bar in words, or ""."""
        return f"{RULES[self.rule][1]} {number(self.bound)}" if self.rule else self.holds

    def within(self, value: float) -> bool:
        """Whether a number is inside of the spread, which has four digits; NaN is not."""
        low, high = self.spread
        return low - DIGITS * abs(low) <= value <= high + DIGITS * abs(high)

    def judge(self, values: Sequence[float], outcome: str = "") -> str:
        """The verdict on a number, on the values of a claim's starts, or on how a hard case ended.

        Of few starts a claim is not testable. A hard case passes if it ends as on file, or misses fewer checks than
        that: which of them are missed differs between processors, as splashes are chaotic; what the run warned of may
        go well.
        """
        if self.kind == CLAIM:
            kept = list(map(self.keeps, values))
            verdict = CONFIRMED if all(kept) else MIXED if any(kept) else REFUTED
            if len(values) < (1 if self.fixed else FEW if self.complete else STARTS):
                verdict = NOT_TESTABLE
            return f"{self.word}: {WENT[verdict]}" if self.word in (OWN_READING, NOT_CLAIMED) else verdict
        if self.kind == HARD_CASE:
            kind, _, missed = outcome.partition(": ")
            known, _, may_miss = self.verdict.partition(": ")
            if kind in (FAILS, WARNED):
                held = kind == known and set(missed.split(", ")) <= set(may_miss.split(", "))
            else:
                held = outcome == self.verdict or (outcome == PASS and known == WARNED)
            return PASS if held else FAIL
        if self.kind == VALUE:
            return PASS if self.within(values[0]) else FAIL
        if not self.rule or not self.misses:
            return SHOWN if not self.rule else PASS if self.keeps(values[0]) else FAIL
        return FAIL if self.keeps(values[0]) else MISSED


@dataclass(frozen=True)
class Family:
    """Claims that are measured alike.

    claims  their names
    fails   how they could have failed, in a sentence
    null    what the null model is, in words; it must refute the claims
    values  what every run gives in it; or model: the function of the experiment that tells a measure's values, which
            takes the arguments `given`
    """

    claims: Sequence[str]
    fails: str
    null: str
    values: Mapping[str, Any] = field(default_factory=dict)
    model: str = ""
    given: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Check:
    """One quantity that was measured, and the verdict on it.

    name     of the entry, with the run after a dot where several runs measure it
    what     the quantity in words
    value    of a claim the median over its starts, whose `values` are kept
    paper    the paper's value, or what stands on file, or ""
    bar      the bar in words, or ""
    verdict  PASS, FAIL, SHOWN or MISSED; a claim fails if its verdict is not the one on file
    found    the verdict on a claim, how a hard case ended
    """

    name: str
    what: str
    value: float
    unit: str
    paper: str
    bar: str
    verdict: str
    kind: str = VERDICT
    values: tuple[float, ...] = ()
    found: str = ""

    def plain(self) -> dict[str, Any]:
        """What `--json` prints of it; a value that is not finite is null."""
        if self.kind == CLAIM:
            return {"values": self.values, "written": self.paper.partition(";")[0], "verdict": self.found}
        value = self.value if math.isfinite(self.value) else None
        return {"value": value, "unit": self.unit, "paper": self.paper, "bar": self.bar, "verdict": self.verdict}

    def measured(self) -> str:
        """The value in words, with the range over the starts."""
        return spread_words(self.values) if self.values else number(self.value)

    def said(self) -> str:
        """The verdict in words."""
        if self.kind != CLAIM:
            return self.verdict
        return self.found if self.verdict == PASS else f"now {self.found}"


def checked(entry: Entry, values: Sequence[float], outcome: str = "", run: str = "", words: str = "") -> Check:
    """The verdict on what was measured; `run` and its `words` name the run that a number comes from."""
    verdict, name, what = entry.judge(values, outcome), entry.name, entry.what
    if entry.kind == CLAIM:
        written = f"{entry.verdict}; {in_range(entry)}" if entry.starts else entry.verdict
        return Check(
            name, entry.title, median(values), entry.unit, written, entry.bar(),
            PASS if verdict == entry.verdict else FAIL, CLAIM, tuple(values), verdict,
        )  # fmt: skip
    if entry.kind == HARD_CASE:
        return Check(name, f"{what}: {outcome}", values[0], entry.unit, "", f"on file: {entry.verdict}", verdict,
                     HARD_CASE, found=outcome)  # fmt: skip
    name, what = (f"{name}.{run}", f"{what}, {words or run}") if run else (name, what)
    return Check(name, what, values[0], entry.unit, entry.paper, entry.bar(), verdict, entry.kind)


@functools.cache
def _read(path: Path) -> tuple[tuple[Entry, ...], dict[str, Any]]:
    """The checks of a file, and its tables. Raises ValueError for a table of another kind."""
    tables = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    if unknown := set(tables) - {"check", "sentence", "family", "map"}:
        raise ValueError(
            f"{path}: an entry is [check.NAME], [sentence.NAME], [family.NAME] or [map.NAME]; there are"
            f" {sorted(unknown)}"
        )
    said = sentences(path.parent.parent)
    entries = (_entry(name, path.parent.name, given, said) for name, given in tables.get("check", {}).items())
    return tuple(entries), tables


@functools.cache
def sentences(folder: Path) -> dict[str, Sentence]:
    """What the sources say, by name, of all experiments in a folder. Raises ValueError for one that is not complete."""
    by_name: dict[str, Sentence] = {}
    for path in sorted(folder.glob("*/expected.toml")):
        for name, given in tomllib.loads(path.read_text(encoding="utf-8")).get("sentence", {}).items():
            needed = {"system", "place", "words", "says", "parameters"}
            if set(given) != needed or name in by_name:
                fault = "stands twice" if name in by_name else f"needs {', '.join(sorted(needed))} and nothing else"
                raise ValueError(f"{path.parent.name}: [sentence.{name}] {fault}")
            by_name[name] = Sentence(name, **given)
    return by_name


def read(experiment: str, kind: str, folder: Path | None = None) -> dict[str, Entry]:
    """The entries of one kind by name, none without a file. Raises ValueError for an entry that is not complete."""
    return {entry.name: entry for entry in read_all(kind, folder) if entry.experiment == experiment}


def families(folder: str) -> list[Family]:
    """The families of claims in the file of a folder."""
    return [Family(**given) for given in _read(FOLDER / folder / "expected.toml")[1].get("family", {}).values()]


def map_words(folder: str, name: str) -> dict[str, str]:
    """What a map shows, in words. Raises KeyError where the folder's file does not say."""
    return _read(FOLDER / folder / "expected.toml")[1]["map"][name]  # type: ignore[no-any-return]


def read_all(kind: str = "", folder: Path | None = None) -> list[Entry]:
    """The entries of all experiments, of one kind or of all."""
    entries = (entry for path in sorted((folder or FOLDER).glob("*/expected.toml")) for entry in _read(path)[0])
    return [entry for entry in entries if not kind or entry.kind == kind]


def forget() -> None:
    """Read files anew, which have been written to."""
    _read.cache_clear()
    sentences.cache_clear()


def _entry(name: str, experiment: str, given: Mapping[str, Any], said: Mapping[str, Sentence]) -> Entry:
    where, kind = f"{experiment}: [check.{name}]", given.get("kind", "")
    if kind not in KINDS:
        raise ValueError(f"{where} has no kind {kind!r}; choose from {', '.join(KINDS)}")
    needed, possible = KEYS[kind]
    rules = [rule for rule in RULES if rule in given]
    if kind == CLAIM and (rules or given.get("verdict") != NOT_TESTABLE):
        needed = needed | _MEASURED
    lacking, unknown = needed - set(given), set(given) - needed - possible - {"kind", "experiment"}
    if lacking or unknown or len(rules) > 1:
        said = f"lacks {sorted(lacking)}" if lacking else f"has {sorted(unknown) if unknown else rules}"
        raise ValueError(f"{where} {said}; a {kind} needs {', '.join(sorted(needed))} and at most one rule")
    known = given.get("verdict", "")
    if kind == CLAIM:
        word, colon, went = known.partition(": ")
        apart = word in (OWN_READING, NOT_CLAIMED)
        if word not in VERDICTS or apart != bool(colon) or (apart and went not in WENT.values()):
            raise ValueError(f"{where} has the verdict {known!r}")
        if given["sentence"] not in said:
            raise ValueError(f"{where} names the sentence {given['sentence']!r}, which no [sentence.NAME] has")
        if apart and not given.get("reason"):
            raise ValueError(f"{where} needs a reason: what the source states otherwise, or does not say")
        if not rules and (known != NOT_TESTABLE or not given.get("reason")):
            raise ValueError(f"{where} needs one rule, or a reason why it cannot be tested")
    if kind == HARD_CASE and (known.partition(":")[0] not in (PASS, WARNED, REFUSED, STOPPED, FAILS)
                              or ("reason" in given) == (known == PASS)):  # fmt: skip
        raise ValueError(f"{where} needs an outcome as its verdict and, unless that is a pass, a reason")
    made = {"experiment": experiment} | {key: value for key, value in given.items() if key not in RULES}
    if kind == CLAIM:
        made["sentence"] = said[given["sentence"]]
    if rules:
        made |= {"rule": rules[0], "bound": given[rules[0]]}
    if "spread" in made:
        made["spread"] = tuple(made["spread"])
    return Entry(name.removeprefix(f"{given.get('experiment', '')}_"), **made)


class Checks:
    """Holds numbers against the bars of an experiment, and keeps the checks in their order (`made`)."""

    def __init__(self, experiment: str, kind: str = VERDICT, folder: Path | None = None) -> None:
        self.entries, self.results = read(experiment, kind, folder), list[Check]()

    def __call__(self, name: str, value: float | None, run: str = "", words: str = "") -> Check:
        """Check one number; `run` and its `words` name the run that it comes from. None and NaN pass no rule."""
        self.results.append(checked(self.entries[name], [real(value)], run=run, words=words))
        return self.results[-1]

    def run(self, results: Mapping[str, Result], key: str, quantities: Quantities, run: str = "", words: str = ""
            ) -> None:  # fmt: skip
        """Check quantities of the run of that key, if it is there, by the names of their checks.

        quantities  {check: name of the run's value, or a function of its values}
        """
        if key in results:
            values = results[key].values
            for name, of in quantities.items():
                self(name, of(values) if callable(of) else values[of], run, words)

    def of_runs(self, results: Mapping[str, Result], words: Callable[[str, Mapping[str, Any]], str]) -> None:
        """Check what entries say of the runs that they name; `words` say what the run of a key and its values is."""
        for key, result in results.items():
            for name, entry in self.entries.items():
                if any(fnmatch.fnmatchcase(key, pattern) for pattern in entry.run.split()):
                    self(name, result.values[entry.quantity or name], key, words(key, result.values))

    def seconds(self, results: Mapping[str, Result]) -> None:
        """Show the processor time of each run [s], by the check of this name."""
        for key, result in results.items():
            if "processor_seconds" in result.about:
                self("seconds", result.about["processor_seconds"], key)


def failed(checks: Iterable[Check]) -> bool:
    """Whether any check failed."""
    return any(check.verdict == FAIL for check in checks)


def number(value: float) -> str:
    """A number with four significant digits, whole numbers in full; "none" for what is not finite."""
    if not math.isfinite(value):
        return "none"
    if isinstance(value, int) or (value == round(value) and abs(value) < 1e6):
        return f"{round(value):,}"
    return f"{value:.4g}"


def spread_words(values: Sequence[float]) -> str:
    """Median and range of some values."""
    low, middle, high = ("infinite" if math.isinf(v) else number(v) for v in (min(values), median(values), max(values)))
    return middle if low == high else f"{middle} ({low} to {high})"


def median(values: Sequence[float]) -> float:
    """The median; of an even number that are not all finite, the upper one. NaN counts as the largest."""
    ordered = sorted(values, key=lambda value: (math.isnan(value), value))
    half = len(ordered) // 2
    if len(ordered) % 2 or not all(map(math.isfinite, ordered)):
        return ordered[half]
    return 0.5 * (ordered[half - 1] + ordered[half])


def in_range(entry: Entry) -> str:
    """Effect and range on file, with their unit and three digits: "1.02 times (0.88 to 1.17)"."""
    unit = "" if entry.unit == "-" else f" {entry.unit}"
    low, middle, high = map(short, (entry.spread[0], entry.measured, entry.spread[1]))
    return f"{middle}{unit}" if low == middle == high else f"{middle}{unit} ({low} to {high})"


def short(value: float) -> str:
    """A number with three significant digits."""
    return "infinite" if math.isinf(value) else number(float(f"{value:.3g}"))
