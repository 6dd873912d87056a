"""What the papers claim, and what was measured of it: `python -m validation claims [CLAIM ...]`.

A claim stands in the `expected.toml` of the experiment that measures it, as `[claim.NAME]`: the source's sentence in
translation, where it stands, the bar, and what was measured. How it is measured is a `Measure` of that name, in
capitals, in the experiment's module `claims`. A claim is confirmed if every start keeps the bar, refuted if none does
and mixed if they disagree. It is not testable with fewer starts than STARTS, or with a reason why it cannot be
measured. Numbers in a reason are templates (`validation.filling`). Claims that are measured alike are a `Family`: it
says how they could have failed, and has a null model, on which every one of them must be refuted.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from refsim.core.errors import InputError
from validation import checks
from validation.checks import CLAIM, RULES, expected, number, read_expected
from validation.experiment import Family, Options, Part, discover
from validation.filling import Recorded, filled, filled_page, stored_values
from validation.perform import perform
from validation.results import finite, origin
from validation.tables import Table

PAGE = Path(__file__).resolve().parent.parent / "docs" / "claims.md"
CONFIRMED, REFUTED, MIXED, NOT_TESTABLE = "confirmed", "refuted", "mixed", "not testable"
STARTS = 5  # least number, unless the claim says why nothing can differ (`fixed`) or that these are all (`complete`)
FEW = 3  # least number where they are all that there are
_WANTED = {"system", "title", "says", "where", "reading", "verdict"}
_MEASURED = {"what", "unit", "measured", "spread", "starts", "over"}


@dataclass(frozen=True)
class Claim:
    """One claim, as it stands on file.

    experiment  in whose folder it stands
    system      whose page it is on
    title       the claim in one short sentence
    says        the source's sentence in translation, or what it amounts to; where: section, equation or figure
    reading     how the source is read: the equations, coefficients and units in force
    what        the quantity in words, with its unit
    rule        at_most, at_least or equals; bound: its number
    measured    effect: median over the starts (seeds, sizes, states); spread: least and largest; starts: how many
    null        the same quantity of the family's null model
    over        what the starts are, in the plural; complete: whether these are all that there are
    fixed       why nothing can differ between starts, where there is one
    reason      why it cannot be tested; of the others, what a reader must know beside the number
    """

    name: str
    experiment: str
    system: str
    title: str
    says: str
    where: str
    reading: str
    verdict: str
    what: str = ""
    unit: str = "-"
    rule: str = ""
    bound: float = math.nan
    measured: float = math.nan
    spread: tuple[float, float] = (math.nan, math.nan)
    starts: int = 0
    over: str = ""
    complete: bool = False
    null: float = math.nan
    fixed: str = ""
    reason: str = ""

    def keeps(self, value: float) -> bool:
        """Whether a value keeps the bar; NaN does not."""
        return bool(RULES[self.rule][0](value, self.bound))

    def bar(self) -> str:
        """The bar in words."""
        return f"{RULES[self.rule][1]} {number(self.bound)}" if self.rule else ""

    def judge(self, values: Sequence[float]) -> str:
        """Confirmed if every start keeps the bar, refuted if none does, mixed otherwise; by few starts not testable."""
        if len(values) < (1 if self.fixed else FEW if self.complete else STARTS):
            return NOT_TESTABLE
        kept = list(map(self.keeps, values))
        return CONFIRMED if all(kept) else MIXED if any(kept) else REFUTED


@dataclass
class Found:
    """What was measured of a claim now, and where; `missing` says why nothing was."""

    claim: Claim
    values: list[float] = field(default_factory=list)
    missing: str = ""
    measured: Mapping[str, Any] = field(default_factory=dict)  # date, commit, machine, seconds

    @property
    def verdict(self) -> str:
        """By the values; "" where there are none."""
        return self.claim.judge(self.values) if self.values else ""

    @property
    def holds(self) -> bool:
        """Whether what was measured says what is written; true where nothing was measured."""
        return not self.values or self.verdict == self.claim.verdict


def read_claims(folder: Path | None = None) -> dict[str, Claim]:
    """The claims of all experiments by name. Raises ValueError for an entry that does not say what it must."""
    folder, found = folder or checks.FOLDER, {}
    for path in sorted(folder.glob("*/expected.toml")):
        for name, entry in expected(path.parent.name, CLAIM, folder).items():
            found[name] = _claim(name, path.parent.name, entry)
    return _with_reasons(found)


def _with_reasons(claims: Mapping[str, Claim]) -> dict[str, Claim]:
    """The claims with the numbers in their reasons, where they have been measured."""
    known, made = records(claims), {}
    for name, claim in claims.items():
        with contextlib.suppress(ValueError):  # a start has been added, and is not measured yet
            claim = dataclasses.replace(claim, reason=filled(claim.reason, known, known[name]))
        made[name] = claim
    return made


def records(claims: Mapping[str, Claim]) -> dict[str, Recorded]:
    """What templates may name of the claims."""
    stored = stored_values()
    return {
        name: Recorded(claim.measured, claim.spread, claim.starts, stored.get(name, []), claim.keeps)
        for name, claim in claims.items()
    }


def _claim(name: str, experiment: str, entry: Mapping[str, Any]) -> Claim:
    rules = [rule for rule in RULES if rule in entry]
    testable = bool(rules) or entry.get("verdict") != NOT_TESTABLE
    lacking = (_WANTED | _MEASURED if testable else _WANTED) - set(entry)
    unknown = set(entry) - _WANTED - _MEASURED - set(RULES) - {"reason", "null", "fixed", "complete"}
    where = f"{experiment}: [claim.{name}]"
    if lacking or unknown:
        raise ValueError(f"{where} lacks {sorted(lacking)} or has unknown keys {sorted(unknown)}")
    if entry["verdict"] not in (CONFIRMED, REFUTED, MIXED, NOT_TESTABLE):
        raise ValueError(f"{where} has the verdict {entry['verdict']!r}")
    if len(rules) != testable or not (testable or entry.get("reason")):
        raise ValueError(f"{where} needs one rule, or a reason why it cannot be tested")
    given = {key: value for key, value in entry.items() if key not in RULES}
    if testable:
        given |= {"rule": rules[0], "bound": entry[rules[0]], "spread": tuple(entry["spread"])}
    return Claim(name=name, experiment=experiment, **given)


def measure(claims: Sequence[Claim], options: Options, jobs: int = 1, compute: bool = True) -> list[Found]:
    """Values of the claims; what is not stored is computed, in `jobs` processes, or left out."""
    made, parts = [Found(claim) for claim in claims], {}
    experiments = discover()
    for found in made:
        claim = found.claim
        if not claim.rule:
            found.missing = claim.reason
            continue
        how = experiments[claim.experiment].claims[claim.name]
        if options.quick and not how.quick:
            found.missing = "takes the published sizes; run without --quick"
            continue
        runs = [dataclasses.replace(run, timed=run.timed or how.timed) for run in how.runs(options)]
        parts[claim.name] = Part(CLAIM, claim.name, claim.experiment, runs, lambda results: ())
    performed = dict(zip(parts, perform(list(parts.values()), options, jobs, compute)))
    for found in made:
        each = performed.get(found.claim.name)
        if each is None:
            continue
        if each.skipped:
            found.missing = next(iter(each.skipped.values()))
        elif not compute and len(each.results) < len(each.part.runs):
            found.missing = "not measured here"
        else:
            for key, why in each.stopped.items():
                print(f"{found.claim.name}: {key} stopped. {why}", file=sys.stderr)
            how = experiments[found.claim.experiment].claims[found.claim.name]
            found.values = [float(value) for value in how.values(each.results)]
            found.measured = origin(each.results.values())
    return made


# Reports


def table(found: Sequence[Found]) -> Table:
    """What is written, and beside it what was measured now."""
    rows, last = [], ""
    for each in found:
        claim = each.claim
        now = spread_words(each.values) if each.values else "-"
        mark = "" if each.holds else f"  now {each.verdict}"
        what = claim.what or claim.says
        then = written(claim) if claim.starts else "-"
        rows.append([claim.system if claim.system != last else "", claim.title, claim.verdict + mark, then, now, what,
                     claim.bar(), claim.name])  # fmt: skip
        last = claim.system
    heading = ["system", "claim", "verdict", "written", "measured now", "quantity", "bar", "name"]
    return Table("Claims of the papers: median (least to largest)", heading, rows)


def spread_words(values: Sequence[float]) -> str:
    """Median and range of some values."""
    ordered = sorted(values)
    low, high = ordered[0], ordered[-1]
    middle = _median(ordered)
    said = ["infinite" if math.isinf(value) else number(value) for value in (middle, low, high)]
    if low == high:
        return said[0]
    return f"{said[0]} ({said[1]} to {said[2]})"


def _median(values: Sequence[float]) -> float:
    ordered = sorted(values, key=lambda value: (math.isnan(value), value))
    half = len(ordered) // 2
    if len(ordered) % 2 or not all(map(math.isfinite, ordered)):
        return ordered[half]
    return 0.5 * (ordered[half - 1] + ordered[half])


def page_table(claims: Mapping[str, Claim], system: str) -> str:
    """The claims of a system as they stand on the page.

    A table with a sentence for each claim, its name last, and its range drawn against its bar; how they could have
    failed; and the sources, each sentence once, with how it is read and what a reader must know beside the number.
    """
    own = [claim for claim in claims.values() if claim.system == system]
    lines = ["| claim, verdict, effect, name | against the bar | confirmed by | null model |",
             "| --- | :---: | --- | --- |"]  # fmt: skip
    for claim in own:
        null = short(claim.null) if claim.starts and not math.isnan(claim.null) else ""
        cells = [f"{_cell(in_words(claim))} (`{claim.name}`)", drawn(claim), claim.bar(), null]
        lines.append(f"| {' | '.join(cells)} |")
    known, families = discover(), dict[int, tuple[Family, list[Claim]]]()
    for claim in own:
        how = known[claim.experiment].claims.get(claim.name)
        if how is not None and how.family is not None:
            families.setdefault(id(how.family), (how.family, []))[1].append(claim)
    if families:
        lines += ["", "How they could have failed, and on which null model they do:", ""]
    for family, members in families.values():
        lines += [f"- {family.fails} Null model: {family.null}. ({_names(members)})"]
    lines += ["", "What the sources say, and how they are read:"]
    sources: dict[tuple[str, str], list[Claim]] = {}
    for claim in own:
        sources.setdefault((claim.says, claim.where), []).append(claim)
    for (says, where), members in sources.items():
        lines += ["", f"> {says} ({where})", "", *_readings(members)]
    return "\n".join(lines)


def in_words(claim: Claim) -> str:
    """Claim, verdict, effect: "It is small: **confirmed**. Its size: 0.5 m, 3 starts."; why it is not testable."""
    said = [f"{claim.what}: {written(claim)}, {counted(claim)}"] if claim.starts else []
    said += [claim.reason] if claim.verdict == NOT_TESTABLE else []
    return " ".join([f"{claim.title}: **{claim.verdict}**.", *map(_sentence, said)])


HALF = 6  # places on each side of the bar
FACTOR = 2.0  # that the outermost place stands for, where effect and bar are positive


def drawn(claim: Claim) -> str:
    """Range and median of a claim against its bar, as `··─●─│······`: what lies on the bar or right of it keeps it.

    Places are logarithmic up to a `FACTOR` where value and bar are positive; otherwise they are linear up to the
    value that is farthest from the bar. Values beyond stand in the outermost place. Empty without a measured value.
    """
    if not claim.starts:
        return ""
    values = (claim.spread[0], claim.measured, claim.spread[1])
    low, middle, high = (_place(claim, value) for value in values)
    low, high = min(low, high), max(low, high)
    places = range(-HALF, HALF + 1)
    marks = ("●" if k == middle else "│" if k == 0 else "─" if low <= k <= high else "·" for k in places)
    return f"`{''.join(marks)}`"


def _place(claim: Claim, value: float) -> int:
    """Place of a value in `drawn`: 0 on the bar, positive where the bar is kept with a margin."""
    if value == claim.bound:
        return 0
    if claim.bound > 0 and min(claim.spread) > 0:
        share = math.log(value / claim.bound) / math.log(FACTOR)
    else:
        finite_ones = [abs(v - claim.bound) for v in (*claim.spread, claim.measured) if math.isfinite(v)]
        share = (value - claim.bound) / max([v for v in finite_ones if v > 0], default=1.0)
    size = HALF if not math.isfinite(share) else min(HALF, max(1, round(abs(share) * HALF)))
    return size if claim.keeps(value) else -size


def _readings(members: Sequence[Claim]) -> list[str]:
    """How one sentence of a source is read, once for all claims made of it if they are read alike, and remarks."""
    remarks = {}
    for claim in members:
        said = [claim.reason] if claim.reason and claim.verdict != NOT_TESTABLE else []
        said += [f"one start is enough: {claim.fixed}"] if claim.fixed else []
        remarks[claim.name] = "".join(f" {_sentence(each)}" for each in said)
    if len({(claim.reading, remarks[claim.name]) for claim in members}) == 1:
        return [f"Reading: {members[0].reading}.{remarks[members[0].name]} ({_names(members)})"]
    if len({claim.reading for claim in members}) == 1:
        noted = [claim for claim in members if remarks[claim.name]]
        lines = [f"-{remarks[claim.name]} ({_names([claim])})" for claim in noted]
        return [f"Reading: {members[0].reading}. ({_names(members)})", "", *lines]
    return [f"- Reading: {claim.reading}.{remarks[claim.name]} ({_names([claim])})" for claim in members]


def _names(members: Sequence[Claim]) -> str:
    return ", ".join(f"`{claim.name}`" for claim in members)


def _cell(words: str) -> str:
    return words.replace("|", "\\|")


def written(claim: Claim) -> str:
    """Effect and range as they are written, with their unit: "1.02 times (0.88 to 1.17)"."""
    unit = "" if claim.unit == "-" else f" {claim.unit}"
    low, middle, high = map(short, (claim.spread[0], claim.measured, claim.spread[1]))
    return f"{middle}{unit}" if low == middle == high else f"{middle}{unit} ({low} to {high})"


def short(value: float) -> str:
    """A number with three significant digits."""
    return "infinite" if math.isinf(value) else number(float(f"{value:.3g}"))


def counted(claim: Claim) -> str:
    """How many starts, and of what."""
    return f"{claim.starts} {claim.over}"


def _sentence(words: str) -> str:
    return f"{words[0].upper()}{words[1:]}{'' if words.endswith('.') else '.'}"


def write(found: Sequence[Found]) -> None:
    """Put what was measured into the experiments' files (numbers and verdict of each entry) and onto the page."""
    for each in found:
        if each.values:
            values = {
                "measured": _rounded(_median(each.values)),
                "spread": [_rounded(min(each.values)), _rounded(max(each.values))],
                "starts": len(each.values),
                "verdict": each.verdict,
            }
            how = discover()[each.claim.experiment].claims[each.claim.name]
            if how.family is not None:
                values["null"] = _rounded(_median(how.family.model(how)))
            path = checks.FOLDER / each.claim.experiment / "expected.toml"
            text = path.read_text()
            begin = re.search(rf"^\[claim\.{each.claim.name}\]$", text, re.MULTILINE).start()  # type: ignore[union-attr]
            stop = text.find("\n[", begin + 1)
            entry = text[begin : stop if stop > 0 else None]
            for key, value in values.items():
                entry, count = re.subn(rf"^{key} = .*$", f"{key} = {_toml(value)}", entry, flags=re.MULTILINE)
                if count != 1:
                    raise ValueError(f"[claim.{each.claim.name}] has {count} lines {key} = ...")
            path.write_text(text[:begin] + entry + (text[stop:] if stop > 0 else ""))
    read_expected.cache_clear()
    write_pages()


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def _toml(value: Any) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return "nan" if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value)


def finding(claim: Claim) -> str:
    """Verdict and effect of a claim in a table of the page of its method."""
    said = f"{claim.what}: {written(claim)}" if claim.starts else claim.reason
    return _cell(f"{claim.verdict}. {_sentence(said)}")


def write_pages() -> None:
    """Renew the tables of `docs/claims.md`, each between its two marks, and the numbers of all pages."""
    claims, text = read_claims(), PAGE.read_text()
    for system in dict.fromkeys(claim.system for claim in claims.values()):
        begin, end = f"<!-- claims of {system} -->\n", f"<!-- end of {system} -->"
        before, _, rest = text.partition(begin)
        _, _, after = rest.partition(end)
        text = f"{before}{begin}\n{page_table(claims, system)}\n{end}{after}"
    PAGE.write_text(text)
    known = records(claims)
    for page in PAGE.parent.glob("*.md"):
        text = page.read_text()
        new = filled_page(text, known, lambda name: finding(claims[name]))
        if new != text:
            page.write_text(new)


def write_figures(found: Sequence[Found], folder: Path) -> None:
    """Write every value of what was measured to `claims.json` among the figures."""
    path = folder / "claims.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    stored = json.loads(path.read_text()) if path.exists() else {}
    for each in found:
        if each.values:
            stored[each.claim.name] = finite(
                {"values": each.values, "unit": each.claim.unit, "bar": each.claim.bar(), "verdict": each.verdict,
                 **each.measured}
            )  # fmt: skip
    lines = [f"{json.dumps(key)}: {json.dumps(value, allow_nan=False)}" for key, value in stored.items()]
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n")


def as_json(found: Sequence[Found]) -> str:
    """One object: every claim's values and verdicts by name."""
    named = {e.claim.name: {"values": e.values, "written": e.claim.verdict, "verdict": e.verdict} for e in found}
    return json.dumps(finite(named), indent=1, allow_nan=False)


def chosen(names: Sequence[str], claims: Mapping[str, Claim]) -> list[Claim]:
    """Claims by their names or their systems'; all without names. Raises InputError for a name that there is not."""
    systems = {claim.system for claim in claims.values()}
    for name in names:
        if name not in claims and name not in systems:
            raise InputError(f"There is no claim or system {name!r}; python -m validation list claim names them.")
    return [claim for claim in claims.values() if not names or claim.name in names or claim.system in names]
