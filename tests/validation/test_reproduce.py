"""The main job: what it runs, how it ends, and the page that it writes."""

from __future__ import annotations

import importlib.util
import json
import re
from pathlib import Path

import numpy as np
import pytest

from tests.validation.test_validation import draw_line as drawn
from validation.checks import CLAIM, FAIL, PASS, SHOWN, Check, read_all
from validation.experiment import Experiment, Options, Picture, RunSpec, discover
from validation.perform import perform
from validation.report import LINES, WIDTH, Whole, page
from validation.results import Result
from validation.tables import Table

pytestmark = pytest.mark.usefixtures("coarse_pictures")
SCRIPT = Path(__file__).resolve().parents[2] / "scripts" / "reproduce.py"


def load_script():
    spec = importlib.util.spec_from_file_location("reproduce", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def computed(context, value):
    return Result({"value": value}, {"line": np.arange(value)})


def made_up(name="fake", verdict=PASS, checks=1, runs=1):
    """An experiment with two pictures (PNG and WebP), a table and checks."""
    words = 'a <quantity> & "more"'
    return Experiment(
        name=name, title="an experiment <for> tests",
        runs=lambda options: [RunSpec(f"run_{k}", computed, {"value": k + 2}) for k in range(runs)],
        checks=lambda found, check: check.results.extend(
            Check(f"quantity.{k}", words, 1.5, "m", "2 & 3", "at most <5>", verdict) for k in range(checks)
        ),
        pictures=tuple(
            Picture(f"{name}_{kind}", lambda found: {"line": found["run_0"].arrays["line"]}, drawn, ("run_0",), shaded)
            for kind, shaded in (("plot", False), ("shaded", True))
        ),
        tables=lambda found: [Table("A <table>", ["what", "value"], [["x<y", 12.5], ["none", None]], "A & B.")],
    )  # fmt: skip


def performed(experiments, folder):
    options = Options(quick=True, results=folder / "results", figures=folder / "figures")
    done = perform([each.part(options) for each in experiments], options)
    claims = [(claim, None) for claim in read_all(CLAIM)]
    titles = {each.name: each.title for each in experiments}
    return Whole("refsim: <a test>", done, titles, claims, 12.3, {"processor": "A & B"}, options.figures)


# What it runs
def test_main_job_is_made_of_runs_that_are_there():
    script, known = load_script(), discover()
    for group in script.MAIN:
        for name, keys in group.items():
            runs = {run.key: run for run in known[name].runs(Options(quick=True))}
            assert set(keys) <= set(runs)
            assert not [key for key in keys if runs[key].skip]
    first, second = script.planned(known, Options(quick=True))
    assert [(part.name, [run.key for run in part.runs]) for part in first + second] == [
        (name, list(keys)) for group in script.MAIN for name, keys in group.items()
    ]
    assert next(iter(script.MAIN[0].items()))[1][0] == "detection_2d"


def test_full_leaves_no_run_out():
    script, known, options = load_script(), discover(), Options()
    groups = script.planned(known, options)
    assert [part.name for part in groups[0]] == list(script.MAIN[0])
    there = {part.name: [run.key for run in part.runs] for parts in groups for part in parts}
    assert there == {name: [run.key for run in each.runs(options)] for name, each in known.items()}


# How it ends
@pytest.mark.parametrize(("verdict", "code"), [(FAIL, 4), (PASS, 0), (SHOWN, 0)])
def test_reproduce_ends_with_a_short_summary_and_writes_the_page(verdict, code, tmp_path, monkeypatch, capsys):
    script = load_script()
    monkeypatch.setattr(script, "ROOT", tmp_path)
    monkeypatch.setattr(script, "MAIN", ({"fake": ("run_0",)},))
    monkeypatch.setattr(script, "discover", lambda: {"fake": made_up(verdict=verdict, checks=60, runs=2)})
    assert script.main(["--quick", "--threads", "1"]) == code
    printed = capsys.readouterr().out
    lines = printed.splitlines()
    assert len(lines) <= LINES + 3, "the head, and the line about the first picture"
    assert max(map(len, lines)) <= WIDTH + len(str(tmp_path))
    assert re.search(r"^First picture after \d+ s: .*fake_plot.png$", printed, re.MULTILINE)
    assert f"{60 * (verdict == PASS)} checks passed, {60 * (verdict == FAIL)} failed" in printed
    assert (" more, see the report" in printed) == (verdict == FAIL)
    assert re.search(r"^It took \d+ s\.$", printed, re.MULTILINE)
    assert (tmp_path / "results" / "report.md").exists()
    assert not (tmp_path / "results" / "fake" / "run_1").exists()
    assert [folder.name[:5] for folder in (tmp_path / "results" / "fake").iterdir()] == ["run_0"]
    assert script.main(["--quick", "--threads", "1", "--json"]) == code
    again = capsys.readouterr()
    assert json.loads(again.out)["quantity.0"]["verdict"] == verdict
    assert "Computing took" not in again.err, "everything was reused"


# The page
def test_page_holds_every_picture_table_and_verdict(tmp_path):
    whole = performed([made_up(), made_up("other", FAIL)], tmp_path)
    text = page(whole, tmp_path / "results" / "report.md")
    heads = re.findall(r"^## (\w+)$", text, re.MULTILINE)
    assert heads == ["summary", "failed", "notes", "fake", "other", "claims"]
    files = [path for each in whole.performed for path in each.drawn.values()]
    shown = re.findall(r"^!\[\w+\]\((.+)\)$", text, re.MULTILINE)
    assert [(tmp_path / "results" / place).resolve() for place in shown] == files
    assert text.count('a <quantity> & "more"') == 3, "twice by experiment, once in what failed"
    assert text.count("A <table>") == 2
    assert all(claim.name in text for claim in read_all(CLAIM))
