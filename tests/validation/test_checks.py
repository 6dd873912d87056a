"""Checks: what is on file is complete, agrees with its records and pages, and is judged as it says."""

import dataclasses
import fnmatch
import inspect
import json
import math
import pathlib
import re
from collections import Counter

import numpy as np
import pytest

from refsim import InputError, RunStopped
from tests.running import rows
from validation import checks, filling, judging, page
from validation.__main__ import main
from validation.checks import CLAIM, CONFIRMED, HARD_CASE, MIXED, NOT_CLAIMED, NOT_TESTABLE, OWN_READING, REFUTED, VALUE
from validation.experiment import Experiment, Measure, Options, RunSpec, discover
from validation.perform import EXIT_FAILED, EXIT_FINE
from validation.results import Result
from validation.running import Context
from validation.trials import Trial, largest_stable

ROOT = pathlib.Path(__file__).resolve().parents[2]
ENTRIES = filling.with_reasons(checks.read_all())
CLAIMS = {entry.name: entry for entry in ENTRIES if entry.kind == CLAIM}
TESTABLE = [name for name, claim in CLAIMS.items() if claim.rule]
MEASURED = [name for name in TESTABLE if CLAIMS[name].starts]
LONG = rows(__file__, "long_claims")


# What is on file
def test_every_claim_has_a_measure_and_every_hard_case_a_trial_and_none_is_left_over():
    measured = {(name, claim) for name, experiment in discover().items() for claim in experiment.claims}
    assert measured == {(CLAIMS[name].experiment, name) for name in TESTABLE}
    hard = [entry for entry in ENTRIES if entry.kind == HARD_CASE]
    assert all(callable(discover()[entry.experiment].trials[entry.trial]) for entry in hard)
    names = [entry.name for entry in ENTRIES if entry.kind in (CLAIM, HARD_CASE, VALUE)]
    assert len(set(names)) == len(names)


def test_every_run_takes_the_parameters_that_it_is_given():
    planned = []
    for experiment in discover().values():
        for options in (Options(peers=True), Options(quick=True), Options(backend="cuda", peers=True)):
            planned += [*experiment.runs(options), *(r for m in experiment.claims.values() for r in m.runs(options))]
            planned += [run for run in judging.trial_part(experiment, options).runs if not run.skip]
    for run in planned:
        inspect.signature(run.function).bind(Context(), **run.parameters)


@pytest.mark.parametrize("name", MEASURED)
def test_what_is_written_follows_from_the_numbers_beside_it(name):
    claim = CLAIMS[name]
    low, high = claim.spread
    assert low <= claim.measured <= high
    assert claim.judge([low, *[claim.measured] * (claim.starts - 2), high][: claim.starts]) == claim.verdict


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n in LONG)) for n in TESTABLE])
def test_the_null_model_of_a_family_refutes_every_claim(name):
    """Without its effect a claim must fail, by its own measure and its own bar."""
    claim = CLAIMS[name]
    values = discover()[claim.experiment].claims[name].null()
    assert values, "put it into a [family.NAME] of expected.toml"
    assert not any(map(claim.keeps, values))
    if claim.starts:
        assert claim.null == pytest.approx(float(np.median(values)), rel=1e-3, abs=1e-12)


def test_the_page_of_checks_counts_the_verdicts():
    count = Counter(claim.word for claim in CLAIMS.values())
    words = " ".join((ROOT / "docs" / "checks.md").read_text(encoding="utf-8").split())
    own = f"{count[NOT_TESTABLE]} not testable, {count[OWN_READING]} own readings and {count[NOT_CLAIMED]} not claimed."
    found = f"{count[CONFIRMED]} are confirmed, {count[REFUTED]} refuted, {count[MIXED]} mixed"
    assert f"Of the {count.total()} claims {found}, {own}" in words


def test_the_page_of_checks_has_every_other_check():
    text = page.CHECKS.read_text(encoding="utf-8")
    assert text == page.checks_page(), "python -m validation claims --write"
    named = re.findall(r"^\| `([\w.]+)` ", text, re.MULTILINE)
    assert sorted([*named, *CLAIMS]) == sorted(entry.name for entry in checks.read_all())


def test_the_pages_of_papers_have_every_claim_beside_its_sentence():
    """Once, so that what is confirmed of a sentence is said beside what is refuted."""
    written = page.paper_pages()
    for path, text in written.items():
        assert path.read_text(encoding="utf-8") == text, "python -m validation claims --write"
    tables = [text.partition("<!-- claims -->")[2].partition("<!-- end of claims -->")[0] for text in written.values()]
    rows = [line for line in "".join(tables).splitlines() if re.match(r"\| .*`", line)]
    told = [re.findall(r"(?:\| |<br>)`(\w+)` ", row) for row in rows]
    assert sorted(name for names in told for name in names) == sorted(CLAIMS)
    for row, names in zip(rows, told, strict=True):
        assert len({CLAIMS[name].sentence for name in names}) == 1
        assert CLAIMS[names[0]].sentence.words in row


def test_numbers_on_the_pages_are_those_of_the_records():
    for path in sorted((ROOT / "docs").glob("*.md")):
        text = path.read_text(encoding="utf-8")
        assert page.renewed(text) == text, f"{path.name}: run python -m validation claims --write"


# How it is judged
SAID = checks.Sentence("small", "s", "section 1, sentence 1", "小", "It is small.", "none")


def claim(**changes):
    given = {
        "name": "one", "experiment": "e", "kind": CLAIM, "sentence": SAID, "title": "It is small",
        "reading": "as printed", "verdict": CONFIRMED, "what": "a size", "rule": "at_most", "bound": 1.0,
    }  # fmt: skip
    return checks.Entry(**given | changes)


def test_every_run_that_a_check_names_is_planned():
    for name, experiment in discover().items():
        keys = [run.key for run in experiment.runs(Options(peers=True))]
        for entry in checks.read_all(checks.VERDICT):
            for pattern in entry.run.split() if entry.experiment == name else ():
                assert fnmatch.filter(keys, pattern), (name, entry.name, pattern)


# The command
def number_of(context, value):
    return Result({"value": value})


@pytest.fixture
def own(tmp_path, monkeypatch):
    """A file and one measure of our own; its values are set by the test."""
    (tmp_path / "e").mkdir()
    (tmp_path / "e" / "expected.toml").write_text(rows(__file__, "expected"), encoding="utf-8")
    values = [0.25, 0.5, 0.75, 0.5, 0.5]

    def runs(options):
        return [RunSpec(f"size_{k}", number_of, {"value": value}) for k, value in enumerate(values)]

    large = checks.Family(("small",), "It could be large.", "a large one", {"value": 9.0})
    one = Measure(runs, lambda results: [result.values["value"] for result in results.values()], family=large)
    monkeypatch.setattr(checks, "FOLDER", tmp_path)
    monkeypatch.setattr(page, "write_pages", lambda: None)
    for module in (judging, page):
        monkeypatch.setattr(module, "discover", lambda: {"e": Experiment("e", "title", claims={"small": one})})
    folders = ["--results", str(tmp_path / "results"), "--figures", str(tmp_path / "figures")]
    return values, folders, tmp_path


def small():
    return next(entry for entry in checks.read_all(CLAIM) if entry.name == "small")


def test_the_command_measures_stores_and_writes(own, capsys):
    values, folders, folder = own
    assert main(["claims", "--write", *folders]) == EXIT_FINE
    printed = capsys.readouterr().out
    assert "0.5 (0.25 to 0.75)" in printed
    assert "No measure." in printed
    written = small()
    assert (written.measured, written.spread, written.starts, written.null) == (0.5, (0.25, 0.75), 5, 9.0)
    text = "".join(page.table())
    assert "0.5 m (0.25 to 0.75), 5 seeds" in text
    assert "It could be large. Null model: a large one, which gives 9." in text
    assert "“It is small indeed.” (小; (1))" in text
    assert json.loads((folder / "figures" / "claims.json").read_text())["small"]["values"] == values
    assert len(list((folder / "results" / "e").iterdir())) == 5
    values[2] = 1.5
    assert main(["check", "small", *folders]) == EXIT_FAILED
    assert "now mixed" in capsys.readouterr().out
    assert small().verdict == CONFIRMED
    assert main(["claims", "--write", *folders]) == EXIT_FINE
    assert small().verdict == MIXED


# Published numbers, computed anew
NUMBERS = {"measured": 2.0, "spread": (1.9, 2.1)}


@pytest.mark.parametrize(("starts", "changed", "told"), [
    ([2.0, 2.0, 2.0, 1.95, 2.3], {}, ("", "")), ([1.899, 1.899, 1.899, 2.0, 2.0], {}, ("", "")),
    (5 * [2.2], {}, ("is 2.2, published is confirmed, 2 m (1.9 to 2.1); find what changed", "published is 2 m")),
    (5 * [2.0], {"measured": 2.2, "spread": (2.15, 2.25)}, ("published is confirmed, 2.2 m (2.15 to 2.25)", "2.2 m")),
    ([2.0, 2.0, 2.0, 2.0, 4.0], {}, ("the verdict is mixed", "")),
    (5 * [1e-3], {"verify": "verdict"}, ("", "is 0.001")),
    (5 * [4.0], {"verify": "verdict"}, ("the verdict is refuted", "is 4")),
])  # fmt: skip
def test_an_altered_number_or_verdict_is_noticed(starts, changed, told):
    """Of a claim by its median, of a value by one run; where numbers are rounding, the verdict alone."""
    runs = [RunSpec(f"start_{k}", number_of, {"value": value}) for k, value in enumerate(starts)]
    measure = Measure(lambda options: runs, lambda results: [each.values["value"] for each in results.values()])
    of = NUMBERS | {"experiment": "fake", "what": "size", "unit": "m"} | changed
    steady = claim(**{"name": "steady", "bound": 3.0, "starts": 5, "verify": "number"} | of)
    first = claim(**of | {"name": "first", "kind": VALUE, "verify": "number", "run": "start_0", "quantity": "value"})
    known = {"fake": Experiment("fake", "for tests", runs=lambda options: runs, claims={"steady": measure})}
    for (_, _, why), words in zip(judging.verify([steady, first], 1, None, known), told, strict=True):
        assert words in why
        assert bool(words) == bool(why)


def test_every_system_has_a_number_that_is_verified_and_can_be_compared_on_any_machine():
    selected = judging.selected()
    assert {entry.system for entry in selected if entry.system} == {entry.system for entry in CLAIMS.values()}
    assert "solutions" in {entry.experiment for entry in selected if entry.kind == VALUE}, "the base liquid"
    for entry in selected:
        if entry.kind == VALUE:
            assert len(judging.value_part(entry, discover()[entry.experiment], Options()).runs) == 1
            continue
        how = discover()[entry.experiment].claims[entry.name]
        runs = how.runs(Options())
        assert entry.starts
        assert runs
        assert not how.timed, f"{entry.name}: times differ between machines"
        assert not any(run.alone or run.skip for run in runs)
        assert entry.verify == "number" or max(map(abs, entry.spread)) < 1e-12, f"{entry.name}: more than rounding"


def test_the_command_compares_with_what_is_written(monkeypatch, capsys):
    assert main(["verify", "repulsion_3d", "--jobs", "1", "--json"]) == EXIT_FINE
    assert json.loads(capsys.readouterr().out)["repulsion_3d"]["now"] == [pytest.approx(1.968, abs=5e-4)]
    altered = dataclasses.replace(CLAIMS["repulsion_3d"], measured=1.978, spread=(1.978, 1.978))
    monkeypatch.setattr(judging, "selected", lambda names: [altered])
    assert main(["verify", "repulsion_3d", "--jobs", "1"]) == EXIT_FAILED
    told = capsys.readouterr()
    assert "deviates" in told.out
    assert "run `python -m validation claims repulsion_3d --write`" in told.err


# The outcomes
def trial(*checks, ends=None):
    made = Trial(Context(), "cpu")
    with made.ending():
        for value in checks:
            made.check("size", value, at_most=1.0)
        if ends is not None:
            raise ends
    return made


def test_outcomes_of_a_trial():
    assert (trial(0.5).outcome, trial(0.5, 1.5).outcome) == ("pass", "fails: size")
    assert (trial(math.nan).outcome, trial(ends=InputError("no.")).outcome) == ("fails: size", "refused")
    assert trial(0.5, ends=RunStopped("diverged", "too fast.")).outcome == "stopped: diverged"
    assert trial(1.5, ends=RunStopped("diverged", "too fast.")).outcome == "fails: size"
    with pytest.raises(ZeroDivisionError), Trial(Context(), "cpu").ending():
        raise ZeroDivisionError


# Measures
@pytest.mark.parametrize("truth", [0.013, 0.4, 3.0, 90.0])
def test_bisection_finds_the_limit_to_the_factor(truth):
    found = largest_stable(lambda x: "" if x <= truth else "tears", 1.0, 0.01, 100.0, factor=1.1)
    assert found.largest <= truth < found.failing <= 1.1 * found.largest
    assert (found.why, [value for value, _ in found.tried]) == ("tears", sorted(value for value, _ in found.tried))
