"""Exercises of the lessons: wrong answers, three and more to each, are told what is wrong with them."""

import functools
import json
import pathlib
import re
import tomllib

import matplotlib
import numpy as np
import pytest

from refsim.io.exercises import HELPERS, Exercises, WrongAnswer, cells, judges, lessons, notebook, number
from refsim.smoothing import reference, smoothing
from tests.running import ROOT, rows

LESSONS = lessons()
every = pytest.mark.parametrize("name", LESSONS)
SLOW = "135678"  # numbers of lessons that compile for long; the others are judged by the same program

MISTAKES = tomllib.loads((pathlib.Path(__file__).parent / "wrong_answers.toml").read_text(encoding="utf-8"))
WRITTEN = [(*row, None)[:3] for row in rows(__file__, "written")]
# Names that mistakes need and a lesson has not.
BESIDE = rows(__file__, "beside")


@functools.cache
def taught(name):
    """The names of a lesson after its code, without the worked answers."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    known = {"__name__": name}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pyplot, "show", lambda: pyplot.close("all"))
        for kind, code in cells(LESSONS[name]):
            if kind == "code":
                exec(code, known)
    exec(BESIDE, known)
    return known


@every
def test_each_exercise_has_a_cell_a_judge_and_a_worked_answer(name):
    pieces = cells(LESSONS[name])
    asked = [
        int(found) for kind, text in pieces if kind == "markdown" for found in re.findall(r"^\*\*(\d)\. ", text, re.M)
    ]
    assert asked == list(judges(LESSONS[name])) == list(range(1, len(asked) + 1))
    assert len(asked) >= 3
    for exercise in asked:
        for kind in ("code", "answer"):
            assert sum(f"check({exercise}, " in text for k, text in pieces if k == kind) == 1, (exercise, kind)
    assert list(map(int, MISTAKES[name])) == asked
    assert all(len(wrong) >= 3 for wrong in MISTAKES[name].values())


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n[0] in SLOW else n for n in LESSONS])
def test_wrong_answers_are_told_what_is_wrong(name):
    known = taught(name)
    said = [verdict.words for verdict in known["check"].verdicts.values()]
    assert all("replace the three dots" in words or "nothing is written" in words for words in said), said
    for exercise, mistakes in MISTAKES[name].items():
        for answer, words in mistakes.items():
            verdict = known["check"].verdict(int(exercise), eval(answer, known))
            assert not verdict.right, (exercise, answer)
            assert words in verdict.words, (exercise, answer)


RIGHT = rows(__file__, "right")


@pytest.mark.parametrize("name", RIGHT)
def test_right_answers_in_other_words_are_right(name):
    for exercise, answers in RIGHT[name].items():
        for answer in answers:
            verdict = taught(name)["check"].verdict(int(exercise), answer)
            assert verdict.right, (exercise, answer, verdict.words)


@pytest.mark.parametrize("text, unit, value", WRITTEN)
def test_a_written_number_is_read_with_its_unit(text, unit, value):
    if value is not None:
        assert number(text, unit) == pytest.approx(value)
        return
    with pytest.raises(WrongAnswer, match=r"asked for|write one number"):
        number(text, unit)


def test_lesson_0_sums_as_refsim_does():
    known = taught("0_smoothed_sum")
    r = np.linspace(0, 0.2, 101)
    assert np.allclose(known["kernel"](r, 0.13), reference.kernel_value(r, smoothing("wendland_c2", 0.13, 2)))
    sums = [
        known["smoothed_sum"](x, known["particles"], np.ones(400), 0.05, 0.13) for x in ((0.5, 0.5), (0, 0.5), (0, 0))
    ]
    assert np.allclose(sums, (0.99324, 0.49662, 0.24831), atol=1e-5)


@every
def test_the_notebook_that_the_site_offers_is_the_lesson(name):
    """Written by `python scripts/lessons.py --notebooks docs/lessons`; cells that print have printed."""
    stored = (ROOT / "docs" / "lessons" / f"{name}.ipynb").read_text(encoding="utf-8")
    code = [cell for cell in json.loads(stored)["cells"] if cell["cell_type"] == "code"]
    printed = ["".join(output["text"] for output in cell["outputs"]) for cell in code]
    assert stored == notebook(LESSONS[name], printed)
    for cell, words in zip(code, printed):
        assert bool(words) >= ("print(" in cell["source"] or "check(" in cell["source"].partition("Exercises(")[2])
        assert len(words) < 4000


def test_check_prints_the_verdict(capsys):
    check = Exercises("0_smoothed_sum", {"kernel": None, "h": 1, "d": 1} | {"kernel": lambda r, h: r})
    check(1, 3 / 16)
    check(1, ...)
    assert capsys.readouterr().out.splitlines() == [
        "Exercise 1: right: (1/2)^4 times 3 is 3/16: near particles count most.",
        "Exercise 1: not yet: replace the three dots by your answer.",
    ]
    assert not check.verdicts[1].right
    assert "compare" in HELPERS
