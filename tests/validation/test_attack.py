"""What looks for faults: attacks, of which none comes back, and slips in host code."""

import importlib
import types

import pytest

from tests import host_slips
from tests.running import rows
from validation import attack
from validation.attack import Damage, plan, reached, resume

SCENES = {name: rows(__file__, name).encode() for name in ("not_coupled", "far_apart")}
FOUND = {  # what was done, and a trial that once ended in a traceback
    "effects that need a solid": (plan, SCENES["not_coupled"]),
    "header of zeros": (resume, ("cloud.npy", [Damage("zeros", 1330, 537)], True)),
    "swapped frames": (resume, ("particles/000003.vtp", [Damage("cut", 8637), Damage("swapped", 2168)], False)),
    "lost checkpoint": (resume, ("checkpoint.h5", [Damage("gone")], False)),
    "numbers that are far apart": (plan, SCENES["far_apart"]),
    "endless stack": (plan, b"spacing = " + b"[" * 5000),
}


@pytest.mark.parametrize("name", FOUND)
def test_what_was_found_does_not_come_back(name, tmp_path):
    perform, trial = FOUND[name]
    assert perform(trial, tmp_path) in ("0", "2")


def test_a_lost_state_and_words_that_are_no_sentence_are_noticed(monkeypatch, tmp_path):
    half, whole = attack._half()
    assert reached(half) != whole
    monkeypatch.setattr("refsim.__main__.main", lambda arguments: 1)
    with pytest.raises(AssertionError, match="exit code 1"):
        attack.outcome_of(["plan"])
    monkeypatch.setattr("refsim.__main__.main", lambda arguments: 2)
    with pytest.raises(AssertionError, match="not one sentence"):
        attack.outcome_of(["plan"])


MODULE = '''
def area(width, height):
    """Two numbers: 1 and 2."""
    if width < 0:
        raise ValueError(f"width {width - 1}")
    return width * height + 3


def rest(rows, flags):
    flags[rows > 2] = True
    flags.set(fontsize=9)
    return rows.reshape(-1, 3)
'''


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A module of two functions."""
    (tmp_path / "small_module.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module("small_module")


def test_what_is_as_good_as_before_is_no_slip(small):
    """A flag that is -1 or 1.01, a size of letters, and -2 for the rest of a shape."""
    slips = [host_slips.altered(small.rest, *change)[1] for change in host_slips.changes(small.rest)]
    assert sorted(words.partition("  ->  ")[2] for words in slips) == [
        "flags[rows <= 2] = True", "flags[rows > 0] = True", "return rows.reshape(+1, 3)", "return rows.reshape(-1, 4)",
    ]  # fmt: skip


def test_slips_are_found_outside_of_words_and_alter_the_answer(small):
    area = small.area
    slips = [host_slips.altered(area, *change) for change in host_slips.changes(area)]
    assert sorted(words.partition("  ->  ")[2] for _, words in slips) == [
        "return width * height + 4", "return width * height - 3", "return width / height + 3", "width < 1",
        "width >= 0",
    ]  # fmt: skip
    answers = set()
    for code, _ in slips:
        try:
            answers.add(types.FunctionType(code, area.__globals__)(2.0, 3.0))
        except ValueError:
            answers.add(None)
    assert (area(2.0, 3.0), answers) == (9.0, {10.0, 3.0, 2 / 3 + 3, None, 9.0})  # 9: only a width of 0 tells
