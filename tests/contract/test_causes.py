"""Words and values of a wrong answer: what is recognised, what no message says, and one trial run again."""

import dataclasses
import itertools
import json
import pathlib
import sys
import types

import numpy as np
import pytest

from refsim.__main__ import main
from refsim.backends.arrays import choose
from refsim.contract import Target
from refsim.contract import drawn as drawn_inputs
from refsim.contract.causes import Diagnosis, first_cause
from refsim.contract.drawn import _judged as judged_on
from refsim.contract.drawn import draw, with_room
from refsim.contract.target import Guards, Outcome
from refsim.core.operation import REGISTRY
from refsim.neighbours.rows import NeighbourRows
from tests.contract import faulty

# Votes
TRAITS = ("with walls", "in float64", "in 3 dimensions", "with up to # neighbours", "up to row #", "sought")


def voter(rng, most):
    """An outcome with drawn traits: right up to a number of neighbours or rows, wrong from another on."""
    wrong = rng.random() < 0.6
    traits = {"sought": bool(rng.random() < 0.8)}
    for name in TRAITS[:-1]:
        if "#" in name:
            low, high = sorted(rng.integers(1, most, 2).tolist())
            traits[name] = (low if rng.random() < 0.9 else None, most // 2 + high if wrong else None)
        elif rng.random() < 0.9:
            traits[name] = (float(rng.choice([0.0, 0.25, 1.0])), float(rng.choice([0.5, 1.0, 1.0])) if wrong else None)
    sign = str(rng.choice(["", "gives 2.5 times", "gives 3 times", "misses 1 of 4"])) if wrong else ""
    usual = ("sph.density", "T2", "cloud", "numpy", "float64", 0)
    values = {"row": 1} if rng.random() < 0.8 else {}
    telling, words = bool(rng.random() < 0.8), "wrong" if wrong else ""
    return Outcome(
        *usual, not wrong, 9.0 if wrong else 0.1, words, telling=telling, sign=sign, values=values, traits=traits
    )


def test_votes_of_drawn_outcomes_are_as_ever(recorded):
    """Which of some signs, which traits and from which numbers on: of many wrong answers, and of one or two."""
    found = {}
    for number in range(150):
        rng = np.random.default_rng(number)
        words = first_cause([voter(rng, 12 + number) for _ in range(1 + number % 9)])
        known = ["2.5", "3 times", "misses", *TRAITS, *(name.replace("#", "") for name in TRAITS if "#" in name)]
        found[f"{number}"] = [word in words for word in known], words
    recorded(found)


@pytest.mark.parametrize("rows", [1, 3, 12])
def test_an_amount_is_told_where_a_guess_with_it_holds_in_all_wrong_rows(rows, recorded):
    """Linear or a power; not where one wrong row is otherwise, or the guess changes nothing."""
    rng, found = np.random.default_rng(rows), {}
    right, part = rng.uniform(1, 2, (20, 3)), rng.uniform(0.5, 1, (20, 3))
    wrong, odd = (np.arange(20) < rows)[:, None], (np.arange(20) == rows - 3)[:, None]
    w = types.SimpleNamespace(right=right, bound=np.full(20, 1e-9), number=np.arange(20), order=np.arange(rows)[::-1])
    w.answer = None

    def change(s, power):
        return (np.sign(s) * abs(s) ** power - 1.0) * part

    for amount, power in itertools.product((1.75, 0.31, -1.0, 0.0, 1.0004), (1, 2, 3)):
        w.off = wrong * change(amount, power)
        guess = lambda s, k, power=power: right[k] + change(s, power)[k]  # noqa: E731
        words = Diagnosis.described(w, "it is # times", guess, 40)
        found[f"{amount} {power}"] = said = [words]
        if power == 1:
            assert float(words.split()[2]) == pytest.approx(amount, rel=1e-4)
            better = Diagnosis.described(w, "gives y # times as large as right", guess, 40)
            assert (better == "gives y with the opposite sign") == (amount == -1)
        assert Diagnosis.described(w, "it is so", lambda s, k: right[k] + w.off[k], 40) == "it is so"
        with np.errstate(invalid="ignore"):  # as `judgement` sets it
            assert Diagnosis.described(w, "it is # times", lambda s, k: right[k], 40) == ""
        for more in (1e-2, 1e-4, 2e-7, 3e-9):
            w.off = wrong * change(amount, power) * (1 + more * odd)
            said.append([bool(Diagnosis.described(w, "# times", guess, most)) for most in (2, 4, 40)])
    recorded(found)


@pytest.mark.parametrize(
    "rows, columns, told", [(1, 1, False), (3, 1, False), (1, 2, False), (1, 3, True), (4, 1, True)]
)
def test_of_two_numbers_no_amount_is_told(rows, columns, told):
    """Any amount would fit them."""
    right, wrong = np.ones((9, columns)), (np.arange(9) < rows)[:, None]
    w = types.SimpleNamespace(
        right=right, off=wrong * 0.75 * right, bound=np.full(9, 1e-9), number=np.arange(9), order=np.arange(rows)
    )
    assert bool(Diagnosis.described(w, "it is # times", lambda s, k: s * right[k], 40)) == told
    assert Diagnosis.described(w, "it is so", lambda s, k: 1.75 * right[k], 40) == "it is so"


LIBRARY = """
import sys
sys.path.insert(0, {root!r})
from tests.contract.faulty import programs
PROGRAMS = programs({fault!r})
"""


@pytest.fixture
def library(tmp_path, monkeypatch):
    """A library in the current folder whose density has no self term."""
    root = str(pathlib.Path(faulty.__file__).parents[2])
    (tmp_path / "own.py").write_text(LIBRARY.format(root=root, fault="no self"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return tmp_path


def test_the_guide_is_printed_without_a_page(capsys):
    assert main(["contract", "--guide"]) == 0
    out = capsys.readouterr().out
    for word in ("PROGRAMS", "--template", "--junit", "actions/setup-python", "add_test", "--replay"):
        assert word in out


def test_the_smallest_failing_input_is_kept_and_run_again(library, capsys):
    assert main(["contract", "own.py", "--step", "T11", "--dtype", "float64", "--variant", "0", "--seed", "3"]) == 4
    assert "sph.density fails: your program leaves out the particle itself" in capsys.readouterr().out
    kept = json.loads((library / "failing_sph.density.json").read_text())
    assert len(kept["case"]["position"]) == 1
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 4
    assert f"FAIL sph.density T11 {kept['trial'].split(':')[-1]}" in capsys.readouterr().out
    assert main(["contract", "own.py", "--replay", kept["trial"]]) == 4  # as it was drawn
    assert "expected" in capsys.readouterr().out
    with np.load("replay.npz") as arrays:
        assert arrays["got/density"] != pytest.approx(arrays["answer/density"])
        assert np.isnan(arrays["before/density"]).all()
        assert {"position", "mass", "smoothing.shape", "bound/density"} <= set(arrays.files)
    assert main(["contract", "own.py", "--replay", kept["trial"].replace("T11:", "T11:no_")]) == 2
    assert "has no such trial" in capsys.readouterr().err
    assert main(["contract", "own.py", "--replay", "T1"]) == 2
    (library / "own.py").write_text((library / "own.py").read_text().replace("no self", ""))
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 0
    (library / "failing_sph.density.json").write_text("{}")
    assert main(["contract", "own.py", "--replay", "failing_sph.density.json"]) == 2


@pytest.mark.parametrize("kind", [np.uint8, np.float64])
def test_the_first_row_that_a_program_changed_is_named(kind):
    """Of rows of one byte, of vectors, of a value alone."""
    for values, place, words in (
        (np.zeros(9, kind), 5, "row 5 first"), (np.zeros((9, 3), kind), (4, 2), "row 4 first"),
        (np.zeros((), kind), (), "row 0 first"),
    ):  # fmt: skip
        guards = Guards(choose("cpu"))
        guards.hold("mass", values)[place] = 1
        assert guards.faults() == [f"it changed its input mass ({words})"]


@pytest.mark.parametrize("number", [0, 1, 4])
def test_particles_are_left_out_until_each_is_needed(number, monkeypatch):
    """Of 15, 67 and 8 those three stay without which a program does not fail."""
    target = Target(REGISTRY["sph.density"], "numpy", "float64", seed=7, dims=(2, 3))
    name = f"drawn 7.{number}"
    needed = draw(target, name).case.position[[1, 4, -2]]

    def judge(_, drawn):
        there = (needed[:, None] == drawn.case.position).all(2).any(1)
        return types.SimpleNamespace(passed=not there.all(), not_judged=False)

    monkeypatch.setattr(drawn_inputs, "_judged", judge)
    assert not drawn_inputs._smallest(target, name).passed
    assert (target.sought.smallest[1].case.position == needed).all()


def test_a_seed_draws_the_same_inputs_as_ever(recorded):
    """A report of an earlier version names trials by seed and number."""
    target = Target(REGISTRY["sph.density"], "numpy", "float64", seed=7, dims=(2, 3))
    found = [draw(target, f"drawn 7.{number}") for number in range(8)]
    recorded({f"{k}": (d.case.state == "tait", d.case, d.gap, d.lengths) for k, d in enumerate(found)})


def test_rows_with_room_behind_them_hold_the_same_neighbours():
    rows = NeighbourRows(np.array([0, 2]), np.array([2, 1], np.int32), np.array([4, 5, 6, 0], np.uint32))
    made = with_room(rows, 3)
    for i in range(2):
        own = slice(made.start[i], made.start[i] + made.count[i])
        assert made.entries[own].tolist() == [[4, 5], [6]][i]
    assert made.start[1] == 5


def test_every_operation_takes_drawn_inputs():
    """The references, which agree with themselves: no argument is left that cannot be made, but for one or two."""
    tried = 0
    for operation in REGISTRY.values():
        target = Target(operation, "numpy", "float64", seed=0, dims=(2, 3))
        drawn = draw(target, "drawn 0.0")
        few = dataclasses.replace(drawn, case=dataclasses.replace(drawn.case, position=drawn.case.position[:70]))
        outcome = judged_on(target, few)
        assert outcome is None or outcome.passed, str(outcome)
        tried += outcome is not None
    assert tried >= len(REGISTRY) - 3
